"""Statistics of sweeps in constant memory: rows come in fixed blocks of worlds, reduced in their order."""

from .intervals import mean_interval, quantile_interval, share_interval

__all__ = ["mean_interval", "quantile_interval", "share_interval"]
