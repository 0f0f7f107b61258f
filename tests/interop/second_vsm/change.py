"""How a fault or a lawful departure is built in: it replaces methods of the finished VSM's parts."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Change:
    """One entry of a table of changes. `build(vsm)` makes it."""

    id: str
    title: str
    build: object
    caught_by: tuple = ()


def table():
    """A table of changes, and the decorator that adds a function to it."""
    changes = {}

    def entry(id, title, caught_by=""):
        def add(build):
            changes[id] = Change(id, title, build, tuple(caught_by.split()))
            return build
        return add
    return changes, entry


def replace(part, name, make):
    """Puts `make(old)` in the place of a method, where `old` is the bound method that was there."""
    setattr(part, name, make(getattr(part, name)))


def each(vsm, what, name, make):
    """The same for a part of every vehicle: `what` is the part's name, or "" for the vehicle itself."""
    for vehicle in vsm.vehicles:
        replace(getattr(vehicle, what) if what else vehicle, name, make)
