"""C and Python templates of generated kernels."""
