"""Pure functions, one op a file: arrays or tensors in, arrays or tensors out."""
