"""First and second derivatives of the specialised step."""
