"""What makes a release: the check of ``make release``, and the recipe for conda."""
