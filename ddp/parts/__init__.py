"""The parts of a workspace: its arrays, the launches of a pass, where passes start from."""
