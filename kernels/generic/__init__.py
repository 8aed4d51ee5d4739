"""The kernels for any scene by tables: their state lies in memory."""
