"""A mechanism watched and pulled at in the browser: engine, server and page of `slcp watch` (paper, V.C)."""
