"""Classes of the ground."""
