"""Access control of the bus: one Zenoh user for each expected process, and guest users for all others.

Every user except the operator publishes under its own keys `rig/<run>/<user>/...` and `loop/<run>/<user>/...` only,
and answers queries and announces itself under the first. A user sends queries only on keys that end in its name,
`rig/<run>/<addressee>/<topic>/<user>`. The hub drops everything else before it reaches Python. The rules cannot
change while the hub is open, so all users exist before it opens: one for each controller of the scene, one for the
recorder, one for the viewer, one that all operators share, and `GUESTS` for processes that the run does not know
beforehand. Every run has new passwords, one file for each user, in a folder that only the present user of the machine
can read. A process becomes a user by locking that file; the kernel releases the lock when the process ends.

Operators and guests may send every query to the plant, also those that end the run or disconnect a controller: a
second terminal can end a run, and a guest asks for its admission on the same topic. All other users may only query the
scene.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.bus import inbound, topics
from rig.bus.address import folder
from rig.errors import BusError
from rig.machine import files

GUESTS = 16
COMMON = ("recorder", "viewer", "operator")
REMOTE = {"recorder": "remote-recorder", "viewer": "remote-viewer"}
"""Seat of a ticket (rig.bus.tickets) -> its user: beside the recorder and the viewer on the plant's host."""
SESSIONS = 64
ACCEPT_MS = 500
FROM_LEAVES = 1 << 20
"""Longest message [bytes] that the hub assembles."""
SHORT = 1 << 16
"""Longest message [bytes] that the hub accepts from a process."""
_DICTIONARY = ".dictionary"
_HERE = ["unixsock-stream", "tcp"]  # links that no other host can reach (rig.bus.address)


def user_of(seat: str) -> str:
    """The user that has the seat of a ticket."""
    return REMOTE.get(seat, seat)


@dataclass
class BusUser:
    """The right to be on the bus as `user` under the name `name`, until `release` or the end of the process."""

    user: str
    name: str
    password: str
    reserved: frozenset[str]
    """Names that guests cannot use: only the user of the same name may publish under them."""
    lock: int = -1

    def release(self) -> None:
        """Give the user back, so that another process can take it."""
        if self.lock >= 0:
            os.close(self.lock)
            self.lock = -1


def _reserved(users: Iterable[str]) -> frozenset[str]:
    return frozenset({"plant", *(user for user in users if not inbound.is_guest(user))})


def invite(run: str, names: Iterable[str], remote: Iterable[str] = ()) -> BusUser:
    """Create the users of a run and return that of its plant; `names` are those of its controllers.

    `remote`: users of tickets, beside those that every run has. Raises BusError for a name that is malformed or taken.
    """
    names = list(names)
    wrong = [
        n for n in names if not topics.is_name(n) or inbound.is_guest(n) or n in ("plant", *COMMON, *REMOTE.values())
    ]
    if wrong:
        taken = f"plant, {', '.join(COMMON)} and guest-... are taken"
        raise BusError(
            f"{', '.join(map(repr, wrong))} cannot name a controller; use letters, digits, '_', '.', '-'; {taken}"
        )
    users = [*dict.fromkeys([*COMMON, *names, *remote]), *(f"guest-{i + 1}" for i in range(GUESTS))]
    here = folder(run)
    shutil.rmtree(here, ignore_errors=True)
    here.mkdir(mode=0o700)
    for user in users:
        _write(here / user, secrets.token_hex(16))
    return BusUser("plant", "plant", secrets.token_hex(16), _reserved(users))


def _write(path: Path, text: str) -> None:
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), "w") as file:
        file.write(text)


def take_user(run: str, role: str, name: str) -> BusUser:
    """Take the user of `name` in `role`, or that of a guest.

    Raises BusError if a controller of this name is connected, if all seats are taken, or if the run has ended.
    """
    here = folder(run)
    topics.of(f"alive/{role}/{name}")
    try:
        users = sorted(path.name for path in here.iterdir() if path.name != _DICTIONARY)
        reserved = _reserved(users)
        if role == "operator":
            return BusUser("operator", name, (here / "operator").read_text(), reserved)
        if name in reserved and name != "plant":
            if (user := _sit(here, name, name, reserved)) is not None:
                return user
            if role == "controller":
                if (ticket := here.with_suffix(".tickets") / f"{name}.ticket").exists():
                    raise BusError(f"the seat of controller {name} of run {run} has the ticket {ticket}: use --ticket")
                raise BusError(
                    f"a controller {name} is already connected to run {run}: end its process first, if it has its own"
                )
        for guest in filter(inbound.is_guest, users):
            given = f"{name}-{guest.partition('-')[2]}" if name in reserved else name
            if (user := _sit(here, guest, given, reserved)) is not None:
                return user
    except OSError as fault:
        raise BusError(f"run {run} has no user for {role} {name}: {here} cannot be read ({fault.strerror})") from None
    raise BusError(
        f"run {run} accepts no further {role} {name}: all {GUESTS} guests are connected; end one of them first"
    )


def _sit(here: Path, user: str, name: str, reserved: frozenset[str]) -> BusUser | None:
    lock = os.open(here / user, os.O_RDWR | os.O_CLOEXEC)
    if not files.take(lock):
        os.close(lock)
        return None
    return BusUser(user, name, os.pread(lock, 256, 0).decode(), reserved, lock)


@contextmanager
def dictionary(run: str) -> Iterator[Path]:
    """Write all users and passwords to the file that Zenoh reads when the hub opens; delete it afterwards."""
    here = folder(run)
    path = here / _DICTIONARY
    _write(path, "".join(f"{file.name}:{file.read_text()}\n" for file in here.iterdir()))
    try:
        yield path
    finally:
        path.unlink()


def rules(run: str, remote: Collection[str] = ()) -> dict[str, Any]:
    """Zenoh's access rules for the users of a run; what they do not allow is denied.

    `remote`: users that may also come by TLS, with a certificate that bears their name.
    """
    prefix = f"rig/{run}/"
    loop = f"loop/{run}/"
    users = sorted(path.name for path in folder(run).iterdir() if path.name != _DICTIONARY)
    looking = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    telling = ["put", "reply", "query", "declare_queryable", "liveliness_token"]
    made = [
        _allow("receive", [*telling, *looking], "egress", [f"{prefix}**", f"{loop}**"]),
        _allow("look", looking, "ingress", [f"{prefix}**", f"{loop}**"]),
        _allow("refuse", ["reply"], "ingress", [f"{prefix}*/param/*/operator"]),
    ]
    policies: list[dict[str, Any]] = [{"rules": ["receive", "look"], "subjects": users}]
    for user in users:
        made.append(_allow(f"ask-{user}", ["query"], "ingress", [f"{prefix}{_asked_by(user)}/{user}"]))
        policies.append({"rules": [f"ask-{user}"], "subjects": [user]})
        if user != "operator":
            own = ["put", "reply", "declare_queryable", "liveliness_token"]
            made.append(_allow(f"own-{user}", own, "ingress", [f"{prefix}{user}/**"]))
            made.append(_allow(f"loop-{user}", ["put"], "ingress", [f"{loop}{user}/**"]))
            policies[-1]["rules"] += [f"own-{user}", f"loop-{user}"]
        # A refusal uses the key of the query, which does not contain the user name of the guest.
        if inbound.is_guest(user):
            policies[-1]["rules"].append("refuse")
    subjects: list[dict[str, Any]] = [{"id": user, "usernames": [user], "link_protocols": _HERE} for user in users]
    for user in remote:
        subjects.append(
            {"id": f"{user} by TLS", "usernames": [user], "cert_common_names": [user], "link_protocols": ["tls"]}
        )
        policies += [{**policy, "subjects": [f"{user} by TLS"]} for policy in policies if user in policy["subjects"]]
    return {"enabled": True, "default_permission": "deny", "rules": made, "subjects": subjects, "policies": policies}


def _asked_by(user: str) -> str:
    """The topics whose queries a user may send."""
    if user == "operator":
        return "**"
    return "plant/**" if inbound.is_guest(user) else "plant/scene"


def _allow(name: str, what: list[str], flow: str, keys: list[str]) -> dict[str, Any]:
    return {"id": name, "messages": what, "flows": [flow], "permission": "allow", "key_exprs": keys}


def bounds(run: str, own: BusUser, users: Path, remote: Collection[str] = ()) -> dict[str, Any]:
    """The hub's settings for users, access rules and limits of message size and number of sessions.

    `remote`: see `rules`.
    """
    limit = {"id": "size", "flows": ["ingress"], "messages": ["put", "delete", "query", "reply"]}
    return {
        "access_control": rules(run, remote),
        "transport/auth/usrpwd/dictionary_file": str(users),
        **login(own),
        "transport/unicast/max_sessions": SESSIONS,
        "transport/unicast/accept_timeout": ACCEPT_MS,
        "transport/link/rx/max_message_size": FROM_LEAVES,
        "low_pass_filter": [{**limit, "key_exprs": ["**"], "size_limit": SHORT}],
    }


def login(own: BusUser) -> dict[str, Any]:
    """The settings with which a process logs in: user and password."""
    return {"transport/auth/usrpwd/user": own.user, "transport/auth/usrpwd/password": own.password}
