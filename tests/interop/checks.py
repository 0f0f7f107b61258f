"""What was checked, printed as it happens and kept for the report."""
import time


class Checks:
    """The verdicts of a run in their order."""

    def __init__(self):
        self.results = []
        self._begun = time.monotonic()
        self._step = ""

    def step(self, name):
        self._step = name
        self._print(f"-- {name}")

    def say(self, line):
        self._print(f"   {line}")

    def check(self, what, held, found=""):
        """Keeps a verdict; what was found is printed where it did not hold."""
        held = bool(held)
        self.results.append({"step": self._step, "what": what, "held": held, "found": "" if held else str(found)})
        self._print(f"   ok    {what}" if held else f"   FAIL  {what}" + (f": {found}" if found != "" else ""))

    def passed(self):
        """True where there were checks and all held."""
        return bool(self.results) and all(r["held"] for r in self.results)

    def close(self):
        failed = [r for r in self.results if not r["held"]]
        self._print(f"{len(self.results)} checks, {len(failed)} did not hold")
        for result in failed:
            self._print(f"   {result['step']}: {result['what']}: {result['found']}")

    def _print(self, line):
        print(f"{time.monotonic() - self._begun:7.2f} {line}", flush=True)
