"""Equilibria among walls against those of another program.

The cases were computed by a prototype with a Newton method of its own, and by SciPy's root finders and optimisers on
energies and gaps written anew from public kinematics and circle geometry (poses equal within 2e-9 mm, and 7e-6 mm where
SLSQP stops early).
"""

import json
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from tests.rollingjoint.walls.outlines import bare, sleeve, walls

CASES = json.loads((Path(__file__).parent / "contact_reference.json").read_text())["cases"]
TOLERANCE = 1e-8  # mm, N


def name_of(case):
    return case["spec"]["name"]


def chain_of(spec):
    return getattr(rj, spec["mech"])(**spec["args"])


def walls_of(case, chain):
    spec, outlines = case["spec"], {"sleeve": sleeve, "bare": bare}
    kind, size = spec["outline"]
    around = spec["sur"]
    lumens = [(around["start"], around["pieces"], around["lumen_k"])] if "pieces" in around else []
    names = {"planes": "planes", "discs": "discs", "segs": "capsules"}
    given = {name: around.get(key, ()) for key, name in names.items()}
    law = {"mu": spec["mu"], "presliding": case["presliding_mm"], "toe": around.get("toe", 0.0)}
    return walls(outlines[kind](chain, size), lumens=lumens, rigid=spec["rigid"], **given, **law)


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_steps_among_walls_are_the_stored_equilibria(case):
    chain = chain_of(case["spec"])
    settings = {"surroundings": walls_of(case, chain), "tension_limits": tuple(case["tension_limits"])}
    rest = chain.neutral_lengths - case["start_tension_N"] / chain.stiffnesses
    loads = [rj.WorldForce(link, (fx, fy), point=(x, y)) for link, x, y, fx, fy in case["spec"].get("loads", ())]
    equilibrium = rj.solve_lengths(chain, rest, loads, **settings)
    for step in case["steps"]:
        command, base = rest + step["command"], step["base"]
        equilibrium = rj.solve_lengths(chain, command, loads, history=equilibrium, base=base, **settings)
        assert equilibrium.status.name == step["status"]
        np.testing.assert_allclose(
            equilibrium.poses + np.array([*base[:2], 0.0]), step["poses"], atol=TOLERANCE, rtol=0.0
        )
        np.testing.assert_allclose(equilibrium.tensions, step["tensions"], atol=TOLERANCE, rtol=0.0)
        np.testing.assert_allclose(equilibrium.wall_forces, step["wall_forces"], atol=TOLERANCE, rtol=0.0)
        contacts = equilibrium.wall_contacts
        assert [contact.candidate for contact in contacts] == [contact["candidate"] for contact in step["contacts"]]
        for contact, stored in zip(contacts, step["contacts"], strict=True):
            assert contact.gap == pytest.approx(stored["gap_mm"], abs=TOLERANCE)
            assert contact.force == pytest.approx(stored["normal_N"], abs=TOLERANCE)
            assert contact.state == pytest.approx(stored["state"], abs=TOLERANCE)
            assert contact.sticks == (stored["sticks"] and case["spec"]["mu"] > 0.0)
