"""Classes of level ground."""
