"""Tables of the documentation: what they train or measure, and how they are printed."""
