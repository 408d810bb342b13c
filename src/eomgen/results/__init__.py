"""Files of results: fields declared with shapes and units, written, read and checked.

Uses forms alone; nothing is known here of robots: what a result is rebuilt from is said by its kind.
"""
