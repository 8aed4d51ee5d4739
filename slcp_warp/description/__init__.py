"""What a mechanism is: bodies, shapes, contacts; scene files and MJCF."""
