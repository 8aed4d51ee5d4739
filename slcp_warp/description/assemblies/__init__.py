"""Parts that several parts of a scene make together: pins, ropes, brakes."""
