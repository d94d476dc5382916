"""`make bench`: measures every number of docs/benchmarks.md on this machine.

`--json FILE` keeps them, `--quick` takes less time, `--map` measures maps alone, `--studies` only studies, `--pages`
only the pages of `rig web`, `--steps` only those of an environment of Gymnasium.
`--loop SECONDS` measures the loop over the bus alone, with a paced run of that length. `--against COMMIT` only compares
the speed with that of another version of the sources.
"""

from __future__ import annotations

import importlib.util
import json
import platform
import sys
from pathlib import Path
from typing import Any

from rig.errors import BusError, UsageError
from rig.qualify.benchmarks import against, kernels, loop, one_contact, pages, recording, studies, twins, whole_runs
from rig.record.provenance import provenance

# Speeds are those of two idle cores on which the kernel of the pendulum does at least 31,000 times real time.
FLOORS = {
    "kernel_rtf": 1e4,
    "whole_rtf": 100.0,
    "twin": 1.15,
    "twin_exact": 1.5,
    "twin_film": 1.8,
    "absent": 1.03,
    "scipy": 200.0,
    "open": 2000.0,
    "python": 250.0,
    "compiled": 1500.0,
    "squeal": 10.0,
    "disc_slider": 1.5,
    "plate": 1.5,
    "plate_96": 0.5,
    "start": 0.7,
    "steps": 30_000.0,
    "step_to_command_ms": 0.5,
    "lockstep": 1.3,
    "paced": 1.0,
    "recorder": 1.0,
    "disc": 100.0,
    "tip": 500.0,
    "tip_waves": 10.0,
    "tip_beam": 20.0,
    "four_dof": 5000.0,
    "map": 0.95,
    "study": 0.95,
    "study_dask": 0.90,
    "study_overhead_ms": 1.0,
    "pictures": 20.0,
    "picture_delay": 0.3,
}


def main() -> int:
    """Measure, print, and return 1 if a floor was missed."""
    quick = "--quick" in sys.argv
    results: dict[str, Any] = {"machine": provenance(0, tuple(sys.argv)), "python": platform.python_version()}
    missed: list[str] = []

    def say(text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def judged(what: str, value: float, floor: str, at_most: bool = False) -> str:
        good = value <= FLOORS[floor] if at_most else value >= FLOORS[floor]
        if not good:
            missed.append(what)
        return f"{'ok' if good else 'MISSED'} (floor {FLOORS[floor]:g})"

    def mapped() -> None:
        say("\nmap of the rig, run-up and run-down, kernels compiled")
        results["map"] = m = one_contact.efficiency(24 if quick else 100)
        verdict = judged("map", m["efficiency"], "map")
        say(f"  {one_contact.MAP}, {m['points']} points: one worker {m['one']:.3g} points/s, two {m['two']:.3g} "
            f"points/s, efficiency {m['efficiency']:.2f} {verdict}")  # fmt: skip

    def studied() -> None:
        say("\nstudies: points per second, one worker, two, and two of dask in turns; efficiency: median (range)")
        dask = importlib.util.find_spec("distributed") is not None
        results["studies"] = {}
        for what in ("P1", "loop"):
            results["studies"][what] = s = studies.measured(what, quick, dask)
            say(f"  {what}, {s['rounds']} rounds of {s['units']} points for each worker: one {s['one']['units']:.3g}/s")
            for name, floor in (("two", "study"), ("dask", "study_dask")):
                if name in s:
                    m = s[name]
                    verdict = judged(f"study {what}, {name}", m["efficiency"], floor)
                    say(f"    {name}: {m['units']:.3g}/s, efficiency {m['efficiency']:.3f} ({m['least']:.2f} to "
                        f"{m['greatest']:.2f}) {verdict}; first result after {m['start']:.1f} s")  # fmt: skip
        if not dask:
            say("  dask is not installed: not measured")
        results["studies"]["overhead_ms"] = ms = studies.overhead_ms(quick)
        verdict = judged("overhead of a point", ms, "study_overhead_ms", at_most=True)
        say(f"  a point that computes nothing: {ms:.3f} ms {verdict}")

    def looped(seconds: float) -> None:
        say("\nloop over the bus: controller and recorder, paced also viewer bridge; alternating with bare round trips")
        try:
            results["bus"] = b = loop.beside_bare(2 if quick else loop.ROUNDS)
        except BusError as error:
            missed.append("loop over the bus")
            say(f"  {error}")
        else:
            say(f"  bare round trip as in `rig doctor`: {b['bare']:.0f} us; back to back: {b['back_to_back']:.0f} us")
            for kind, what in (("lockstep", "a tick"), ("paced", "put to command, p50")):
                ratio = b["over_bare"][kind]
                verdict = judged(f"{kind} over bare", ratio, kind, at_most=True)
                say(f"  {kind}: {what} {b[kind]:.0f} us, ratio {ratio:.2f} {verdict}")
            say(f"  lockstep over back to back: ratio {b['over_bare']['lockstep_back_to_back']:.2f}")
            say(f"  publishing takes {b['publish']:.0f} us of a paced frame (mean)")
        say(f"\npaced, 1 kHz, vibrometer 10 kHz in blocks, controller, recorder, viewer bridge, {seconds:g} s")
        results["loop"] = paced = loop.paced(seconds)
        trip, late, bare = paced["round_trip"], paced["timing"]["lateness"], paced["bare_us"]
        verdict = judged("step to command", trip["p50"] / 1e3, "step_to_command_ms", at_most=True)
        lost = sum(paced["lost"].values())
        if lost:
            missed.append("nothing lost")
        timing = paced["timing"]
        say(f"  {paced['verdict']}: {timing['late_share']:.2%} of the frames late, {lost} messages lost; "
            f"the host took {timing['stolen_share']:.2%} of the processors")  # fmt: skip
        say(f"  lateness {late['p50']:.0f} / {late['p99']:.0f} / {late['max']:.0f} us (p50, p99, worst)")
        spread = f"p50 {trip['p50'] / 1e3:.2f} ms, p99 {trip['p99'] / 1e3:.2f} ms"
        say(f"  put to the command in the plant's queue: {spread} {verdict}")
        say(f"  bare unix socket, same run: p50 {bare['p50'] / 1e3:.2f} ms, p99 {bare['p99'] / 1e3:.2f} ms")
        for name, counts in paced["loop"].items():
            aged = f"{counts['late']} older than a frame, oldest {counts['oldest']} frames"
            say(f"  {name}: {counts['taken']} commands, {aged}")

        say("\npaced, plate under a slider on 40 points, steps of 2 us, recorder, viewer bridge")
        results["plate"] = paced = loop.plate()
        timing = paced["timing"]
        if paced["verdict"] == "INVALID":
            missed.append("plate, paced")
        say(f"  {paced['verdict']}: {timing['late_share']:.2%} of the frames late; "
            f"the host took {timing['stolen_share']:.2%} of the processors")  # fmt: skip

    def watched() -> None:
        say(f"\nrig web: {pages.PAGES} pages without a browser, one in Chromium, on a paced run at 1 kHz")
        results["pages"] = seen = pages.pages(10.0 if quick else 30.0)
        if seen["verdict"] != "VALID":
            missed.append("a run that is watched is VALID")
        say(f"  {seen['verdict']}: {'; '.join(seen['reasons'])}")
        for name in ("sockets", "browser"):
            if (pictures := seen[name]) is None:
                say("  Chromium is not installed: not measured in a browser")
                continue
            rate = judged(f"pictures per second, {name}", pictures["rate"], "pictures")
            delay = judged(f"delay of pictures, {name}", pictures["p99"], "picture_delay", at_most=True)
            say(f"  {name}: {pictures['rate']:.1f} pictures/s {rate}; delay at most {pictures['p50']:.3f} s (p50), "
                f"{pictures['p99']:.3f} s (p99) {delay}")  # fmt: skip

    def stepped() -> None:
        say("\nenvironment of Gymnasium, one frame of 1 ms a step, processor time")
        results["steps"] = s = one_contact.steps(3 if quick else 7)
        if not s:
            say("  gymnasium is not installed: not measured")
            return
        say(f"  {one_contact.DRIVEN}: {s['steps']:.0f} steps per second {judged('steps', s['steps'], 'steps')}; "
            f"four rigs at once {s['four']:.0f}; a reset {1e3 * s['reset']:.2f} ms")  # fmt: skip

    def finish() -> int:
        if "--json" in sys.argv:
            Path(sys.argv[sys.argv.index("--json") + 1]).write_text(json.dumps(results, indent=1, default=str))
        if missed:
            say(f"\nfloors missed: {', '.join(missed)}")
        return 1 if missed else 0

    say(f"machine: {results['machine']}")
    if "--against" in sys.argv:
        commit = sys.argv[sys.argv.index("--against") + 1]
        say(f"\nspeed over that of {commit}: processor time, {against.ROUNDS} rounds, floor {against.FLOOR:g}")
        try:
            results["against"] = speeds = against.compared(commit, say)
        except UsageError as error:
            say(str(error))
            return 2
        missed += against.missed(speeds)
        return finish()
    if "--map" in sys.argv:
        mapped()
        return finish()
    if "--studies" in sys.argv:
        studied()
        return finish()
    if "--steps" in sys.argv:
        stepped()
        return finish()
    if "--pages" in sys.argv:
        watched()
        return finish()
    if "--loop" in sys.argv:
        looped(float(sys.argv[sys.argv.index("--loop") + 1]))
        return finish()
    say("\nreal-time factor of the pendulum, 1 ms samples, over event-time error (of a period)")
    results["precision"] = rows = kernels.precision()
    for row in rows:
        how = f"tol {row['tolerance']:.0e}" if row["method"] == "dopri5" else f"{row['substeps']} steps/ms"
        how = "" if row["method"] == "exact" else how
        say(f"  {row['law']:9}{row['method']:8}{how:12} error {row['error']:8.1e}   {row['rtf']:9.0f} x real time")
    for target in (1e-4, 1e-6, 1e-8):
        for method in ("exact", "dopri5", "rk4"):
            enough = [r["rtf"] for r in rows if r["method"] == method and r["error"] <= target]
            say(f"  error {target:.0e}  {method:8}{max(enough, default=0.0):9.0f} x real time")
    best = max((r["rtf"] for r in rows if r["law"] == "stribeck" and r["error"] <= 1e-6), default=0.0)
    say(f"  kernel at 1e-6 (Stribeck): {best:.0f} x  {judged('kernel', best, 'kernel_rtf')}")

    say("\nC twins, gcc -O3 -march=native, interleaved, best of rounds")
    results["twins"] = ratios = twins.twins()
    if "skipped" in ratios:
        say(f"  {ratios['skipped']}")
    else:
        rows_of = (("quiet", "tick", "twin"), ("rk4", "step", "twin"), ("exact", "tick", "twin_exact"),
                   ("film", "step", "twin_film"))  # fmt: skip
        for name, unit, floor in rows_of:
            t = ratios[name]
            verdict = judged(f"C twin {name}", t["ratio"], floor, at_most=True)
            ours, theirs = t[f"ns_per_{unit}"], t[f"ns_per_{unit}_c"]
            say(f"  {name:6} {ours:6.1f} ns/{unit}, C {theirs:6.1f}: ratio {t['ratio']:.2f} {verdict}; "
                f"largest difference of results {t['largest_difference']:.1e}")  # fmt: skip
        stiff = ratios["exact"]
        verdict = judged("stiff shunt", stiff["rtf"], "kernel_rtf")
        say(f"  exact on the stiff shunt of belt_shunt, 3400 Hz at 1 ms: {stiff['rtf']:.0f} x real time {verdict}, "
            f"error of event times {stiff['error']:.1e} of a period")  # fmt: skip
    results["absent"] = a = whole_runs.cost()
    verdict = judged("absent effects", a["ratio"], "absent", at_most=True)
    say(f"  forces without products: {a['ns']:.1f} ns, compiled without their source {a['ns_without']:.1f}: "
        f"ratio {a['ratio']:.3f} {verdict}")  # fmt: skip
    results["scipy"] = versus = kernels.scipy_ratio()
    verdict = judged("scipy", versus["ratio"], "scipy")
    say(f"  exact over scipy solve_ivp (DOP853, rtol 1e-9, events): {versus['ratio']:.0f} x faster {verdict}; "
        f"scipy's event error {versus['scipy_event_error']:.1e} s")  # fmt: skip

    say("\nwhole rig simulate pendulum: sensors, controller, protocol, outputs kept")
    results["whole"] = w = whole_runs.simulate(3 if quick else 7)
    verdict = judged("whole", w["rtf"], "whole_rtf")
    say(f"  {w['seconds']:.0f} s in {w['wall']:.3f} s: {w['rtf']:.0f} x real time {verdict}")
    say("  a further second of a run, alternating, processor time:")
    results["marginal"] = further = whole_runs.marginal(2 if quick else 5)
    for name, rtf in further.items():
        say(f"  {whole_runs.CASES[name].title}: {rtf:.3g} x real time {judged(name, rtf, name)}")
    results["start"] = s = whole_runs.start(3 if quick else 7)
    say(f"  new process, 10 s simulated: {s['wall']:.2f} s wall (worst {s['worst']:.2f}) "
        f"{judged('start', s['wall'], 'start', at_most=True)}")  # fmt: skip

    stepped()
    say(f"\n{one_contact.DISC} with seven modes: growth rate of the simulation beside the eigenvalue, kernel")
    results["disc"] = growing = one_contact.growth()
    for row in growing:
        say(f"  tol {row['tolerance']:.0e}  error {row['error']:8.1e}   {row['rtf']:9.0f} x real time")
    best = max((r["rtf"] for r in growing if r["error"] <= 1e-4), default=0.0)
    say(f"  at 1e-4 of the growth rate: {best:.0f} x real time {judged('disc', best, 'disc')}")

    say("\nrigs of one contact, kernel without energy balance, alternating, processor time")
    results["rubbing"] = quick_ones = one_contact.speed(5 if quick else 10)
    for name, rtf in quick_ones.items():
        say(f"  {one_contact.CASES[name].title}: {rtf:.3g} x real time {judged(name, rtf, name)}")

    say("\nrecorder: 10 sensors at 100 kHz in blocks, 8 outputs at 1 kHz")
    results["recording"] = kept = recording.recording(3.0 if quick else 20.0)
    verdict = judged("recorder", kept["recorder"], "recorder", at_most=True)
    if kept["lost"]:
        missed.append("recorder lost nothing")
    say(f"  {kept['recorder']:.2f} of a core {verdict}, {kept['messages']} messages, {kept['lost']} lost, "
        f"{kept['bytes'] / 1e6:.1f} MB")  # fmt: skip
    say(f"  on the publishing thread: {kept['mean_us']:.0f} us of a frame (mean), {kept['p99_us']:.0f} us (p99)")

    looped(10.0 if quick else 60.0)
    watched()
    mapped()
    studied()
    return finish()


if __name__ == "__main__":
    sys.exit(main())
