"""From shapes to rows: signed distances, Jacobians, which rows act, the problem of a step."""
