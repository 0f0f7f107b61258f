#!/usr/bin/env python3
"""Runs the second CUCS: `second_cucs.py --help`. The parts are in the package beside this file."""
from second_cucs.program import main

if __name__ == "__main__":
    main()
