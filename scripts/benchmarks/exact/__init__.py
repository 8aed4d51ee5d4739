"""Problems with exact solutions, and the event-driven integration behind them."""
