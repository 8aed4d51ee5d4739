"""Commands of the paper's own experiment: the quickstart, the library's size, the contact surface."""
