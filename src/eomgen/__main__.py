"""python -m eomgen."""

import sys

from .cli import main

sys.exit(main())
