"""The parts of a plant process, shared by the module that runs it and the one that finalises it."""

from __future__ import annotations

import queue
import sys
import threading
from collections.abc import Callable
from typing import Any

from rig import design, placement, scheduling
from rig.bench import pace
from rig.bench.controllers_in_plant import ControllersInPlant
from rig.bench.experiment import Experiment
from rig.bench.frame_batches import FrameBatches, length
from rig.bench.housekeeping import Housekeeper
from rig.bench.hub import Hub
from rig.bench.job import Job
from rig.bench.operator_commands import Operator
from rig.bench.prepared_rigs import PreparedRigs
from rig.bench.runner import PlantRunner
from rig.bench.timing import Timing
from rig.bus.port import Session
from rig.bus.run_setup import Setup
from rig.errors import RigError
from rig.plants.structures import model_store
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.scenes.scene import Scene


class PlantParts:
    """The parts of one run of a job on an open session: plant runner, experiment, hub and what serves them."""

    def __init__(self, session: Session, job: Job) -> None:
        self.session, self.job = session, job
        self.scene = scene = Scene.from_json(job.scene)
        with model_store.collected() as self.models:
            self.runner = runner = PlantRunner(scene, piece=length(scene, job.pace))
        duration_ns = run_length_ns(job.duration)
        self.experiment = Experiment(scene, runner, duration_ns, self._retune)
        self.cores = placement.choose()
        """Cores of the plant's thread (in a paced run) and of the threads of the bus."""
        self.setup = self._setup()
        self.hub = hub = Hub(session, self.experiment, self.setup, job.in_lockstep)
        self.operator = Operator(hub)
        self.prepared_rigs: PreparedRigs | None = None
        """Rigs that a paced run builds in advance."""
        self.frame_batches = FrameBatches(self.experiment, job.pace)
        self.timing = Timing(self.frame_batches.length * runner.frame_ns / (job.pace or 1.0), self.frame_batches.length)
        self.housekeeper = Housekeeper(hub, self.operator, job, self.timing)
        self.in_plant = ControllersInPlant(session, self.experiment, self.setup.controllers, self.housekeeper.notice)
        self.fault = ""
        """Why the numerics stopped the run."""
        self.interrupted = False
        """Whether a signal ended the run before the end that its protocol or its duration sets."""
        self.from_start: set[tuple[str, str]] = set()
        """Processes that were connected at the first frame."""
        self.waiting: pace.Waiting | None = None
        self.memory = ""
        """Why the memory of a paced run is not locked; "" if it is."""
        self.ahead: scheduling.Ahead | None = None
        """The real-time scheduling of a paced run."""
        self.begun_ns = 0
        self.refusals: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.say: Callable[[str], object] = lambda _: None
        """Gets lines for the user."""

    def recorders(self) -> list[str]:
        """The recorders of the run that are here."""
        return [name for role, name in self.hub.watch.present if role == "recorder" and self.is_recorder(name)]

    def is_recorder(self, name: str) -> bool:
        """Whether a recorder is that of the run: expected, or under a name that no guest can use."""
        return name in self.session.inbound.reserved or ("recorder", name) in self.job.expect

    def _setup(self) -> Setup:
        scene, runner = self.scene, self.runner
        return Setup(
            run=self.session.run,
            scene=scene.made_with(self.models).to_json() if self.models else self.job.scene,
            frame_ns=runner.frame_ns,
            step_ns=runner.step_ns,
            outputs={name: runner.units[name] for name in runner.outputs},
            sensors={n: (u, p) for n, u, p in zip(runner.bank.names, runner.bank.units, runner.bank.periods_ns)},
            controllers=design.described(scene),
            paced=self.job.pace is not None,
            core=self.cores[1],
            provenance=provenance(scene.seed, self.job.command or tuple(sys.argv)),
            models=tuple(self.models.values()),
        )

    def _retune(self, controller: str, changes: dict[str, Any]) -> None:
        """Ask a controller to change its parameters. A paced run does not wait for the answer of another process."""
        if controller in self.scene.in_plant:
            self.in_plant.retune(controller, changes)
            return
        if self.job.in_lockstep:
            self.session.ask(f"param/{controller}", {"set": changes}, timeout=2.0)
            return

        def ask() -> None:
            try:
                self.session.ask(f"param/{controller}", {"set": changes}, timeout=2.0)
            except RigError as fault:
                self.refusals.put(f"{controller}: {fault}")

        threading.Thread(target=ask, name=f"retune-{controller}", daemon=True).start()
