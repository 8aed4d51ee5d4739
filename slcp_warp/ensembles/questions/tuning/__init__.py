"""Numbers of a policy or a design, chosen by how it does in disturbed worlds."""
