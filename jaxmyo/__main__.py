"""`python -m jaxmyo` is the command `jaxmyo`."""

import sys

from jaxmyo.cli import main

sys.exit(main())
