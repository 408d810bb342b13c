"""Programs of derivatives, from those of the functions that they differentiate."""
