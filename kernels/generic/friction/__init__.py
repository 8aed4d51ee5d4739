"""Coulomb's hard friction in the generic kernels: directly on modes, a fixed point behind them; jams."""
