"""A second VSM with a simulated aircraft behind it, written from the oracles alone.

It stands on `tests/data/dli` (the reference codec and its tables), on the contracts of the DLI and on the
catalogue of rules, and on no code of the bridge: where the conformance suite passes both, a rule is not
merely a picture of one implementation. Every fault that the suite has to find is a switch of it
(`mutants.py`), and so is every lawful departure that the suite must not blame (`variants.py`); both
replace single methods, so that the parts below stay free of them. In reading order:

    wire           bytes to messages and back
    edition25      the same for Edition 2.5: its wrapper and messages become those of Edition 4
    units          angles, altitudes, times, places on the earth
    aircraft       the simulated aircraft: modes, a flown route, launch, landing, battery
    authority      who may have and who holds which level of interoperability; handover
    mission        the plan: upload, validation, download
    steering       modes and settings: 2016, 2017, 2005, 2007, 2008, 2010
    payload        two simulated camera stations
    alerts         16000: raise, change, clear, repeat to whom has just connected
    configuration  the configuration phase, and what is available when
    reports        the content of every status message
    vehicle        one vehicle: its parts, and which of them handles which message
    vsm            sockets, stations, acknowledgements, duplicates, schedules
    mutants, variants, program
"""
