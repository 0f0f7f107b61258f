"""A second ground station, written from the oracles alone: a subject for the conformance suite's rules for a CUCS.

It shares the careful codec of the second VSM and nothing else. `display` is what its operator would see,
`station` what it does on the wire, `faults` the 25 faults that the suite has to find, `program` the steps of
a script and the command line.
"""
