"""All hostile requests against one server, each followed by the question whether it still serves everybody else."""

import threading
import time

from jobs import rooms
from service.bar import Bar
from service.process import Server

from . import addresses, bodies, framing, headlines, names, queries, representations, slowness
from .attack import Attack, Scene
from .verdict import Verdicts
from .wire import carry_out


def set_scene(server: Server) -> Scene:
    """Two small maps to be attacked."""
    connection = server.connection(120.0)
    found = {}
    for distance in ("sdf", "vdf"):
        job = connection.ask("POST", "/v1/jobs", rooms.job(7, 0.4, distance)).json()
        while job["status"] in ("accepted", "running"):
            job = connection.ask("GET", f"/v1/jobs/{job['id']}?wait=20").json()
        found[distance] = job
    return Scene(server.port, found["sdf"]["map_id"], found["vdf"]["map_id"], found["sdf"]["id"], rooms.job(7, 0.5))


def catalogue(scene: Scene) -> list[Attack]:
    kinds = (slowness, framing, headlines, names, addresses, representations, bodies, queries)
    return [attack for kind in kinds for attack in kind.attacks(scene)]


def run(server: Server, verdicts: Verdicts, only: str | None = None) -> int:
    """Carries out the catalogue; how many attacks that were. The slow ones go on beside the others."""
    scene = set_scene(server)
    attacks = [attack for attack in catalogue(scene) if only is None or only in attack.name]
    called = [attack.name for attack in attacks]
    assert len(set(called)) == len(called), sorted({name for name in called if called.count(name) > 1})
    slow = [
        threading.Thread(target=_attempt, args=(attack, scene, verdicts)) for attack in attacks if "slow" in attack.tags
    ]
    for thread in slow:
        thread.start()
    bar = Bar("requests", len(attacks))
    for number, attack in enumerate(attacks):
        if "slow" in attack.tags:
            continue
        bar.at(number, attack.name)
        _attempt(attack, scene, verdicts)
        trouble = unwell(server, scene)
        if trouble:
            verdicts.fail(f"{attack.name}: afterwards {trouble}")
            server.kill()
            server.start()
            server.until_ready()
    for thread in slow:
        thread.join()
    bar.end()
    return len(attacks)


def _attempt(attack: Attack, scene: Scene, verdicts: Verdicts) -> None:
    try:
        verdicts.judge(attack, carry_out(attack, scene.port))
    except OSError as error:
        verdicts.fail(f"{attack.name}: {error!r}")


def unwell(server: Server, scene: Scene) -> str | None:
    """What is wrong with the service for a client that means no harm, if anything is."""
    if not server.alive():
        return f"the process has ended ({server.child.returncode})"
    for method, path, body in (
        ("GET", "/livez", None),
        ("GET", f"/v1/jobs/{scene.job}", None),
        ("POST", f"/v1/maps/{scene.sdf}/query", {"points": [[1, 1]]}),
    ):
        began = time.monotonic()
        try:
            status = server.connection(8.0).ask(method, path, body).status
        except OSError as error:
            return f"{method} {path[:20]} fails after {time.monotonic() - began:.0f} s: {error}"
        if status != 200:
            return f"{method} {path[:20]} is {status}"
    return None
