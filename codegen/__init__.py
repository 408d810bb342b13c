"""The generator: from a model to C source and a compiled module."""
