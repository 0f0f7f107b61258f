#!/usr/bin/env python3
"""What a station sees when the bridge or the aircraft dies and comes back; the caller kills and restarts.

    survive.py prepare --vsm HOST:PORT ...    take control and upload a route, then leave without a word
    survive.py resume  --vsm HOST:PORT ...    after a new start of the bridge: all of it must still be there; fly
    survive.py silence --vsm HOST:PORT ...    after the end of the aircraft: it must be reported
    survive.py return  --vsm HOST:PORT ...    after a new start of the aircraft: its link must be restored
"""
import sys

import cucs as dli
import fly
from cucs import Failure
from route import WGS84, survey


class Survival(fly.Flight):
    """The steps of a flight, cut in pieces."""

    def steps(self):
        return {"prepare": (self.connect, self.learn_the_place, self.take_control, self.upload),
                "resume": (self.connect, self.still_in_control, self.learn_the_place, self.still_loaded, self.launch,
                           self.fly, self.land),
                "silence": (self.connect, self.silent),
                "return": (self.connect, self.learn_the_place)}[self.options.verb]

    def connect(self):
        self.answer = self.cucs.discover(self.s(10)).fields

    def learn_the_place(self):
        if not self.answer.get("LOI Granted"):
            self.cucs.authority(dli.LOI_2, dli.REQUEST, 5)
        m = self.cucs.wait(lambda m: m.id == 4000 and "Latitude" in m.fields
                           and m.fields.get("Altitude Type") == WGS84, self.s(30), what="a position with its WGS-84 height")
        self.start = dli.place(m)

    def still_in_control(self):
        held = self.answer.get("LOI Granted")
        self.check("#2 says that this CUCS holds LOI 2, 4 and 5 as before", held == 0xD, self.answer)

    def still_loaded(self):
        # As uploaded before: heights above the ellipsoid may differ by the noise of the position.
        self.route = survey(True)
        since = self.cucs.mark()
        self.cucs.send(13000, {"Mission ID": fly.ROUTE_MISSION, "Mission Plan Mode": 3, "Waypoint Number": 0}, ack=True)
        self.cucs.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(20), since, "the end of the download")
        chain = {m.fields["Waypoint Number"]: m.fields.get("Next Waypoint") for m in self.cucs.inbox[since:] if m.id == 13002}
        self.check("the route is still there", chain == {p.number: p.next for p in self.route.points}, chain)

    def silent(self):
        c, since = self.cucs, self.cucs.mark()
        c.authority(dli.LOI_2, dli.REQUEST, 5)
        m = c.wait(lambda m: m.id == 3002 and m.fields.get("UA State") == 0, self.s(15), since, "3002 with UA State 0, unknown")
        alerts = [m.fields.get("Text") for m in c.inbox if m.id == 16000]
        self.say(f"UA State 0; 16000: {alerts}")
        c.pump(1.0)
        late = [m.value for m in c.inbox[c.inbox.index(m):] if m.id == 4000 and "Latitude" in m.fields]
        self.check("4000 claims no position of a silent vehicle", not late, late[:1])

    def run(self):
        try:
            for step in self.steps():
                self.checks.step(step.__name__.replace("_", " "))
                step()
        except Failure as failure:
            self.check(str(failure), False)
            self.come_down()
        self.check("everything received can be decoded", not self.cucs.unreadable, self.cucs.unreadable[:3])
        return self.checks.passed()


if __name__ == "__main__":
    verb = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if verb not in ("prepare", "resume", "silence", "return"):
        sys.exit(__doc__)
    options = fly.arguments()
    options.verb = verb
    survival = Survival(options)
    held = survival.run()
    survival.checks.close()
    sys.exit(0 if held else 1)
