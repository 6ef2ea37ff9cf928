"""What a region may be, by its features and by how near annotated points lie."""
