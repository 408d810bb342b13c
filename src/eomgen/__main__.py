"""python -m eomgen."""

import sys

from .cli.entry import main

sys.exit(main())
