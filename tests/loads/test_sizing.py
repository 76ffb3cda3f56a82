"""Torques of the driven creases are what the structure's energy says they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid

from ori_deploy.errors import InputError
from ori_deploy.loads import Air, Film, Loads, Magnets, Solids, Twists, clamp_of, hinge_torques, masses_kg
from ori_deploy.motion import ConeMechanism, Mechanism, mechanism_of
from ori_deploy.motion.mechanism import Linkage
from tests import cones, shapes
from tests.design.turned import Kind, flat_sided

CLOSE_A = 2
LOADS = Loads(gravity_m_s2=(1.0, -9.0, 2.0))


@cache
def cases() -> dict[str, tuple[Linkage[Any], Solids]]:
    made: dict[str, tuple[Linkage[Any], Solids]] = {}
    for name in ("wing", "one cell", "two inner vertices", "peanut 8"):
        structure = shapes.structure(name)
        made[name] = mechanism_of(structure), Solids.of(structure, 1.26)
    for name in ("elliptic 6", "wing, apex below", "tapered wing"):
        cone = cones.cone(name)
        made[name] = mechanism_of(cone, 1.5), Solids.of(cone, 1.0, 0.5)
    kinds: tuple[Kind, ...] = ("cylinder", "cone")
    for kind in kinds:  # some of whose panels have no area
        flat = flat_sided(kind, 4, 0.3, 0.2, 0.0)
        assert (flat.panel_areas == 0.0).any()
        made[f"flat-sided {kind}"] = (
            mechanism_of(flat, 1.5),
            Solids.of(flat, 1.26 if kind == "cylinder" else 1.0, 0.5),
        )
    return made


def driven(linkage: Linkage[Any], crease: int = CLOSE_A) -> Any:
    return np.full(linkage.n_cells, crease)


def energy(linkage: Linkage[Any], solids: Solids, loads: Loads, folds: Any) -> Any:
    """Energy at fold vectors, by the poses alone: an independent way."""
    clamp = clamp_of(linkage.layout, loads)
    matrices = linkage.poses(folds).matrices()
    k = matrices.shape[-1] - 1
    centre = solids.centroid[:, :k]
    place = np.einsum("tpij,pj->tpi", matrices[..., :k, :k], centre) + matrices[..., :k, k]
    turn, shift = matrices[:, clamp, :k, :k], matrices[:, clamp, :k, k]
    seen = np.einsum("tji,tpj->tpi", turn, place - shift[:, None])
    weight = masses_kg(linkage.layout, solids, loads)[:, None] * np.array(loads.gravity_m_s2)[:k]
    bend = linkage.four_bars.angles(folds) - loads.film.rest_rad
    stiffness = loads.film.stiffness_nm(solids.span_m)
    return -np.einsum("tpi,pi->t", seen, weight) + 0.5 * stiffness * (bend**2).sum(axis=(1, 2))


@pytest.mark.parametrize("name", cases())
@pytest.mark.parametrize("fold", [0.05, 0.4, 0.9])
@pytest.mark.parametrize("panel", [0, 3, -2])
def test_torque_is_the_energys_derivative_cell_by_cell(name: str, fold: float, panel: int) -> None:
    linkage, solids = cases()[name]
    loads = replace(LOADS, clamp=linkage.layout.panel_ids[panel])
    n, h = linkage.n_cells, 1e-5
    folds = fold + h * np.concatenate([np.eye(n), -np.eye(n)])
    u = energy(linkage, solids, loads, folds)
    slope = (u[:n] - u[n:]) / (2.0 * h)
    torques = hinge_torques(linkage, solids, loads, driven(linkage), [fold])
    rate = linkage.four_bars.transmission(np.array([fold]))[0, :, CLOSE_A]
    np.testing.assert_allclose(torques.holding[0] * rate, slope, atol=1e-6 * np.abs(slope).max())


def test_work_along_the_motion_is_the_energy_gained() -> None:
    linkage, solids = cases()["wing"]
    fold = np.linspace(0.0, 1.0, 4001)
    torques = hinge_torques(linkage, solids, LOADS, driven(linkage), fold)
    angle = linkage.four_bars.angles(fold)[:, :, CLOSE_A]
    work = float(trapezoid(torques.holding, angle, axis=0).sum())
    first, last = energy(linkage, solids, LOADS, np.array([[0.0] * 4, [1.0] * 4]))
    assert work == pytest.approx(last - first, rel=1e-4)


def test_which_crease_is_driven_changes_torque_by_its_transmission() -> None:
    linkage, solids = cases()["wing"]
    rates = linkage.four_bars.transmission(np.array([0.5]))[0]
    power = [
        hinge_torques(linkage, solids, LOADS, driven(linkage, c), [0.5]).holding[0] * rates[:, c] for c in range(4)
    ]
    np.testing.assert_allclose(power, np.broadcast_to(power[0], (4, 4)), rtol=1e-9)


@pytest.mark.parametrize("name", cases())
def test_masses_are_those_of_the_exact_areas(name: str) -> None:
    linkage, solids = cases()[name]
    areas = linkage.structure.panel_areas
    volume = areas * (1.5**3 - 0.5**3) / 3.0 if isinstance(linkage, ConeMechanism) else areas * 1.26
    np.testing.assert_allclose(solids.volume, volume, rtol=2e-3)


@pytest.mark.parametrize("name", cases())
def test_a_solids_inertia_is_one_that_a_body_can_have(name: str) -> None:
    _, solids = cases()[name]
    for panel in range(len(solids.volume)):
        a, b, c = np.linalg.eigvalsh(solids.inertia(panel))
        assert (a > 0.0) == (solids.volume[panel] > 0.0)
        assert c <= a + b + 1e-9 * c


def test_a_cone_with_its_apex_far_off_is_a_cylinder() -> None:
    far = 600.0
    cone, plane = cones.coned("wing", (0.25, 0.0, far), 0.005 / far), shapes.structure("wing")
    thin, flat = mechanism_of(cone, far), mechanism_of(plane)
    loads = replace(
        LOADS, gravity_m_s2=(1.0, -9.0, 0.0), film=Film(thickness_m=1e-4), air=Air(wind_m_s=(0.0, 5.0, 0.0))
    )
    a = hinge_torques(thin, Solids.of(cone, 0.01, far - 0.005), loads, driven(thin), [0.1, 0.6])
    b = hinge_torques(flat, Solids.of(plane, 0.01), loads, driven(flat), [0.1, 0.6])
    for part in ("gravity", "film", "air"):
        np.testing.assert_allclose(getattr(a, part), getattr(b, part), atol=0.01 * np.abs(getattr(b, part)).max())


def test_film_of_the_example_wing_is_as_the_hardware_page_reckons() -> None:
    structure = shapes.wing(0.005, chord=0.25)
    linkage, solids = Mechanism(structure), Solids.of(structure, 1.26)
    torques = hinge_torques(linkage, solids, Loads(clamp="c1.cb"), np.array([2, 3, 2, 3]), [1.0])
    assert Film().stiffness_nm(1.26) == pytest.approx(0.0525)
    assert masses_kg(structure.layout, solids, Loads()).sum() == pytest.approx(0.91, abs=0.005)
    assert torques.film[0, [0, 2]] == pytest.approx([0.37, 1.29], abs=0.01)


def test_even_pressure_pushes_a_closed_section_nowhere() -> None:
    for name in ("wing", "peanut 8"):
        linkage, solids = cases()[name]
        del linkage
        np.testing.assert_allclose(solids.skin.area.sum(axis=0), 0.0, atol=1e-12)


def test_skin_looks_outwards() -> None:
    for linkage, solids in cases().values():
        skin = solids.skin
        if isinstance(linkage, Mechanism):
            middle = np.array([linkage.structure.embedding.z.mean().real, linkage.structure.embedding.z.mean().imag])
            assert np.einsum("ni,ni->n", skin.area[:, :2], skin.point[:, :2] - middle).sum() > 0.0
        else:
            axis = linkage.structure.profile.apex + linkage.structure.profile.to_user(np.array([0.0, 0.0, 1.0]))
            away = skin.point - axis
            assert np.einsum("ni,ni->n", skin.area, away).sum() > 0.0


def test_pressure_does_the_work_of_the_volume_it_displaces() -> None:
    linkage, solids = cases()["one cell"]
    loads = Loads(gravity_m_s2=(0, 0, 0), film=Film(thickness_m=0.0), air=Air(pressure_pa=100.0))
    h, fold = 1e-5, 0.6
    torque = hinge_torques(linkage, solids, loads, driven(linkage), [fold])
    # One cell's skin is the whole outline: what it encloses, panel ends joined, is the volume.
    structure = linkage.structure
    ends = structure.profile.point(np.array([np.linspace(a, b, 4000) for a, b in structure.outline_pieces]))

    def enclosed(at: float) -> float:
        poses = linkage.poses(at)
        z = np.concatenate([poses.turn[p, 0] * ends[p] + poses.shift[p, 0] for p in (0, 1, 2, 3)])
        return float(0.5 * (np.conj(z) * np.roll(z, -1)).imag.sum()) * solids.span_m

    slope = (enclosed(fold + h) - enclosed(fold - h)) / (2.0 * h)
    rate = linkage.four_bars.transmission(np.array([fold]))[0, 0, CLOSE_A]
    assert torque.air[0, 0] * rate == pytest.approx(100.0 * slope, rel=0.01)


def test_wind_pushes_at_what_faces_it_and_nothing_else() -> None:
    linkage, solids = cases()["wing"]
    twists = Twists.of(linkage, solids, [1.0])
    from ori_deploy.loads import skin_forces

    turn = twists.matrices[:, solids.skin.panel, :3, :3]
    force = skin_forces(solids.skin, Air(wind_m_s=(0.0, 5.0, 0.0)), turn, linkage.structure.profile.period)[0]
    lower = solids.skin.area[:, 1] < 0.0
    assert (force[~lower] == 0.0).all()
    # 15 Pa times the coefficient on a nearly flat underside.
    assert force[:, 1].sum() == pytest.approx(0.5 * 1.2 * 25.0 * 1.2 * 1.26, rel=0.1)


def test_friction_counts_in_both_directions() -> None:
    linkage, solids = cases()["wing"]
    calm = hinge_torques(linkage, solids, LOADS, driven(linkage), [0.3])
    rubbed = hinge_torques(linkage, solids, replace(LOADS, friction_nm=0.01), driven(linkage), [0.3])
    rates = np.abs(linkage.four_bars.transmission(np.array([0.3])))[0]
    expected = 0.01 * rates.sum(axis=1) / rates[:, CLOSE_A]
    np.testing.assert_allclose(rubbed.worst - calm.worst, expected[None], rtol=1e-9)


def test_a_clamp_or_mass_that_is_nowhere_is_refused_by_name() -> None:
    linkage, solids = cases()["wing"]
    with pytest.raises(InputError, match="clamp: unknown panel"):
        clamp_of(linkage.layout, Loads(clamp="c9.ac"))
    with pytest.raises(InputError, match="extra_kg: unknown panel"):
        masses_kg(linkage.layout, solids, Loads(extra_kg={"c1.xx": 1.0}))
    assert clamp_of(linkage.layout, Loads(clamp="c2")) == 4


def test_magnets_hold_as_much_as_they_say() -> None:
    magnets = Magnets(force_n=20.0)
    pull = magnets.pull_n(np.linspace(0.0, 0.02, 2001))
    assert pull.max() == pytest.approx(20.0, rel=0.05)
    assert pull[0] == 0.0
    assert magnets.pull_n(np.array([magnets.seat_m])) == pytest.approx(20.0)
    assert magnets.pull_n(np.array([magnets.seat_m + magnets.reach_m])) == pytest.approx(5.0)
    assert magnets.pull_n(np.array([1.01 * magnets.capture_m])) == 0.0
