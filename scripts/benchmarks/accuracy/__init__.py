"""Speed against accuracy, charted: studies, their references, peers and pictures (`slcp bench charts`)."""
