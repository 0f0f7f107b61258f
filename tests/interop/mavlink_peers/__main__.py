"""Runs a subject."""
from .program import main

main()
