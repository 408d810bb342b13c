"""Laws of coordinates with states of their own: their formulas, one file each, and the element that they act by."""
