"""Labels of points and instances."""
