#!/usr/bin/env python3
"""Runs the second VSM: `second_vsm.py --help`. The parts are in the package beside this file."""
from second_vsm.program import main

if __name__ == "__main__":
    main()
