"""What stands on the bench, one file each: physical parameters in, rows out. `PLANTS` is the list."""

from __future__ import annotations

PLANTS: dict[str, str] = {
    "belt": "rig.plants.belt",
    "brake": "rig.plants.brake",
    "disc_slider": "rig.plants.disc_slider",
    "four_dof": "rig.plants.four_dof",
    "lever": "rig.plants.lever",
    "north": "rig.plants.north",
    "pendulum": "rig.plants.pendulum",
    "pin": "rig.plants.pin",
    "plate": "rig.plants.plate",
    "points": "rig.plants.points",
    "tip": "rig.plants.tip",
    "tip_beam": "rig.plants.tip_beam",
    "tread": "rig.plants.tread",
    "two_dof": "rig.plants.two_dof",
}
