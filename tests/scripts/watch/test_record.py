"""Records of a watched run: where they end, and what becomes of one that cannot be written."""

import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
from test_engine import ME, finger_engine, grabbed, stepped

from slcp_warp.scripts.watch.record import Replay


def recorded(engine, steps=5):
    engine.send(ME, {"do": "record", "value": True})
    stepped(engine, steps)


def test_a_record_ends_with_its_last_step_whatever_comes_after(tmp_path):
    engine = finger_engine(tmp_path)
    recorded(grabbed(engine, [0.9, -2.2]))
    last = engine.worlds.state.copy()
    engine.send(ME, {"do": "reset"})
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    replay = Replay(tmp_path / "watch-000.npz")
    np.testing.assert_array_equal(replay.arrays["states"][-1], last)
    np.testing.assert_array_equal(replay.again(finger_engine().worlds), replay.arrays["states"])


def test_a_record_that_cannot_be_written_is_kept(tmp_path, capsys):
    """Until its folder is there again; and elsewhere where the page ends before."""
    folder = tmp_path / "gone"
    engine = finger_engine(folder)
    recorded(engine)
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    assert "gone" in engine.said and engine.recording is not None
    folder.mkdir()
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    assert len(Replay(folder / "watch-000.npz").arrays["controls"]) >= 5 and engine.recording is None
    shutil.rmtree(folder)
    recorded(engine)
    stop = threading.Event()
    stop.set()
    engine.run(stop, lambda: None)
    path = capsys.readouterr().err.split()[-1]
    assert len(Replay(Path(path)).arrays["controls"]) >= 5
    shutil.rmtree(Path(path).parent)


def test_a_full_record_that_cannot_be_written_stops_no_page(tmp_path, monkeypatch):
    """It takes no more steps, the mechanism goes on, and it is written once that can be done."""
    monkeypatch.setattr("slcp_warp.scripts.watch.record.MOST_BYTES", 2000)
    folder = tmp_path / "gone"
    engine = finger_engine(folder)
    recorded(engine, 30)
    rows, steps = len(engine.recording.rows), engine.steps
    assert "the record is full, and is kept" in engine.said and not engine.paused
    stepped(engine, 10)
    assert len(engine.recording.rows) == rows < 30 and engine.steps == steps + 10
    assert engine.time == pytest.approx(engine.steps * engine.worlds.step_size)
    folder.mkdir()
    engine.send(ME, {"do": "record", "value": False})
    engine.advance(0.0)
    assert len(Replay(folder / "watch-000.npz").arrays["controls"]) == rows and engine.recording is None
    recorded(engine, 30)
    assert "the record is full; wrote" in engine.said and engine.recording is None
