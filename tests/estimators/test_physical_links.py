"""Physical links: what comes out could exist, reproduces what it should, and says what holds it."""

import numpy as np
import pinocchio as pin
import pytest
from cases import exact_log, made, quick, random_values, robot, states
from scaled_robots import scaled

from frischid.cli.pages.exporting import consistency as consistent_page
from frischid.effects import BASELINE
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.nominal_links import Links
from frischid.estimators.physical_links import LEAST_LINK_SHARE, Extras, InfeasibleError, consistent
from frischid.export.consistency import as_identified, make_consistent
from frischid.model.comparison import compare
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.inertia import dynamic_parameters, is_physical, pseudo_inertia, redistributed


def random_links(count=5, seed=0):
    """Parameters of clouds of twenty point masses, 0.1 to 20 kg, a few centimetres to decimetres in size."""
    rng = np.random.default_rng(seed)
    links = []
    for _ in range(count):
        points = np.append(
            rng.normal(size=(20, 3)) * rng.uniform(0.02, 0.2, 3) + rng.normal(0, 0.1, 3), np.ones((20, 1)), 1
        )
        links.append(dynamic_parameters(points.T * rng.uniform(0.005, 1) @ points))
    return np.array(links)


def model_of(name, noise=0.02, seconds=20.0, **options):
    machine = robot(name)
    values = random_values(machine, BASELINE)
    log = exact_log(machine, BASELINE, values, noise=Noise(tau=noise), seconds=seconds)
    return quick(machine, [log], **options).model


# ---- bodies


def test_pseudo_inertia_and_back():
    theta = random_links()
    np.testing.assert_allclose(dynamic_parameters(pseudo_inertia(theta)), theta, rtol=1e-12)
    assert is_physical(theta).all()


def test_unphysical_bodies_are_seen():
    heavy, negative, flat = random_links(3)
    negative[0] *= -1
    flat[[4, 6, 9]] = 1.0, 1.0, 5.0  # breaks the triangle inequality
    assert is_physical(np.array([heavy, negative, flat])).tolist() == [True, False, False]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_parts_become_another_body(count):
    parts, whole = pseudo_inertia(random_links(count)), pseudo_inertia(random_links(1, seed=3)[0])
    new = redistributed(parts, whole, 0)
    np.testing.assert_allclose(new.sum(axis=0), whole, atol=1e-12 * np.abs(whole).max())
    assert is_physical(dynamic_parameters(new)).all()
    if count > 1:  # every part keeps its share of the mass
        np.testing.assert_allclose(new[:, 3, 3] / whole[3, 3], parts[:, 3, 3] / parts[:, 3, 3].sum(), rtol=1e-9)


def test_parts_without_mass_give_all_to_the_main_one():
    whole = pseudo_inertia(random_links(1)[0])
    new = redistributed(np.zeros((3, 4, 4)), whole, 1)
    np.testing.assert_array_equal(new[1], whole)
    assert not new[[0, 2]].any()


def test_flat_parts_stay_physical():
    flat = np.zeros((2, 10))
    flat[:, 0] = 2.0, 1.0  # two point masses
    flat[1, 1] = 0.3
    flat[1, [6, 9]] = 0.09
    whole = pseudo_inertia(random_links(1)[0])
    new = redistributed(pseudo_inertia(flat), whole, 0)
    np.testing.assert_allclose(new.sum(axis=0), whole, atol=1e-12 * np.abs(whole).max())
    assert is_physical(dynamic_parameters(new)).all()


# ---- the convex problem


def problem(seed=0, rows=12, noise=0.0, **links):
    """Random base parameters of three links and two extras."""
    rng = np.random.default_rng(seed)
    nominal = random_links(3, seed)
    true = np.concatenate([random_links(3, seed + 1).ravel(), [0.5, 2.0]])
    K = rng.normal(size=(rows, 32))
    theta = K @ true
    sigma = noise * np.abs(theta) + 1e-3
    theta = theta + sigma * rng.normal(size=rows) * (noise > 0)
    beliefs = {"nominal": nominal, "boxes": (None,) * 3, "known": np.full((3, 10), np.nan), "length": 1.0} | links
    extras = Extras(("e1", "e2"), np.zeros(2), np.ones(2), np.array([1, 1]))
    return theta, np.diag(1 / sigma**2), K, Links(("one", "two", "three"), **beliefs), extras


@pytest.mark.parametrize("seed", range(4))
def test_reproduces_what_physical_links_made(seed):
    theta, information, K, links, extras = problem(seed)
    found = consistent(theta, information, K, links, extras)
    assert found.feasible
    assert found.reproduces
    assert found.misfit < 1e-2
    assert not found.blame
    assert is_physical(found.theta[:30].reshape(3, 10)).all()
    assert (found.theta[30:] >= 0).all()
    np.testing.assert_allclose(found.base, K @ found.theta)
    assert ((found.base - theta) @ information @ (found.base - theta)) < 1.1


def test_the_prior_itself_is_returned_if_it_fits():
    _, information, K, links, extras = problem()
    extras = Extras(extras.names, np.array([0.5, 2.0]), extras.scale, extras.signs)
    at_prior = np.concatenate([links.nominal.ravel(), [0.5, 2.0]])
    found = consistent(K @ at_prior, information, K, links, extras)
    np.testing.assert_allclose(found.theta, at_prior, rtol=1e-3, atol=1e-3)
    assert found.divergence.max() < 1e-4


def test_the_divergence_does_not_depend_on_units():
    theta, information, K, links, extras = problem()
    scale = np.diag([1e3] * 10 + [1e-3] * 10 + [1.0] * 12)  # a heavy link and a light one
    found = consistent(theta, information, K, links, extras)
    nominal = (scale[:30, :30] @ links.nominal.ravel()).reshape(3, 10)
    scaled = Links(links.names, nominal, links.boxes, links.known, links.length)
    again = consistent(theta, information, K @ np.linalg.inv(scale), scaled, extras)
    np.testing.assert_allclose(again.divergence, found.divergence, rtol=1e-2, atol=1e-3)


def test_what_cannot_be_reproduced_is_blamed_on_its_link():
    theta, information, K, links, extras = problem(rows=32)
    true = np.linalg.solve(K, theta)
    true[10] = -5.0  # the second link's mass
    found = consistent(K @ true, information, K, links, extras)
    assert found.feasible
    assert not found.reproduces
    assert found.blame[0][0] == "two"
    assert any(a.where == "two" for a in found.active)


def test_impossible_demands_name_link_and_constraint():
    known = np.full((3, 10), np.nan)
    known[2, 0] = -1.0
    with pytest.raises(InfeasibleError, match=r"three: no rigid body has its values known outright \(m = -1\)"):
        consistent(*problem(known=known))
    known = np.full((3, 10), np.nan)
    known[0, :2] = 1.0, 0.5  # the centre of mass at x = 0.5
    box = np.vstack([np.eye(3), -np.eye(3)]), np.full(6, 0.1)
    with pytest.raises(InfeasibleError, match=r"one: no rigid body has its values .* and its centre of mass within"):
        consistent(*problem(known=known, boxes=(box, None, None)))


def test_known_values_and_boxes_are_kept():
    known = np.full((3, 10), np.nan)
    known[1, 0] = 3.0
    box = np.vstack([np.eye(3), -np.eye(3)]), np.full(6, 0.05)
    theta, information, K, links, extras = problem(known=known, boxes=(box, None, None))
    K[:, 10] = 0.0
    found = consistent(theta, information, K, links, extras)
    assert found.theta[10] == 3.0
    assert (np.abs(found.theta[1:4]) <= 0.05 * found.theta[0] * (1 + 1e-6)).all()


def test_nominal_links_that_cannot_exist_are_replaced_and_named():
    nominal = random_links(3)
    nominal[0] = 0.0
    nominal[1, [4, 6, 9]] = 0.1, 0.1, 100.0
    found = consistent(*problem(nominal=nominal))
    assert found.feasible
    assert "one: the URDF gives this link no mass" in found.notes[0]
    assert "two: no body can have the URDF's inertia of this link" in found.notes[1]


def test_shapes_are_checked():
    theta, information, K, links, extras = problem()
    with pytest.raises(InputError, match="mapping of shape"):
        consistent(theta, information, K[:, :-1], links, extras)


# ---- models


@pytest.mark.parametrize("name", ["planar2", "ur10", "ur10 far_end tilted", "mixed mimic", "tiago torso and arm"])
def test_a_model_becomes_physical_and_stays_as_good(name):
    model = model_of(name)
    found = make_consistent(model)
    assert found.result.feasible
    assert found.result.reproduces
    assert found.result.eigenvalues.min() > 0.5 * LEAST_LINK_SHARE
    assert is_physical(found.model.links).all()
    machine = robot(name)
    log = exact_log(machine, BASELINE, random_values(machine, BASELINE), seed=9, noise=Noise(tau=0.02))
    assert compare(found.model, [log]).nrmse <= 1.05 * compare(model, [log]).nrmse


@pytest.mark.parametrize(("length", "mass"), [(1e-3, 1.0), (1e-3, 1e-9), (30.0, 3e4)])
def test_a_robot_of_any_size_becomes_physical(length, mass):
    """The arm's second link is 0.5 m long, 0.5 mm, or 15 m."""
    machine = scaled(robot("planar2"), length, mass, np.sqrt(length))
    log = simulate(machine, random_fourier(machine, 10.0, seed=1), rate=100.0, noise=Noise(q=1e-5))
    found = make_consistent(quick(machine, [log]).model)
    assert found.result.reproduces
    np.testing.assert_allclose([found.model.standard[n] for n in ("m1", "m2")], machine.nominal[[0, 10]], rtol=0.01)


def test_the_physical_model_is_its_base_parameters():
    found = make_consistent(model_of("planar2"))
    q, v, a = states(robot("planar2"))
    bare = Model.from_dict({**found.model.to_dict(), "standard": None})
    np.testing.assert_allclose(
        bare.inverse_dynamics(q, v, a), found.model.inverse_dynamics(q, v, a), rtol=1e-9, atol=1e-9
    )
    event = found.model.history[-1]
    assert event["action"] == "consistent"
    assert found.model.previous is not None
    again = Model.from_dict(found.model.to_dict())
    assert again.standard == found.model.standard


def test_the_printed_chi_squared_is_that_of_the_links_found():
    """Beside changes of 0.6 standard errors the page had a χ² of 0.0, which was that before the step to the URDF."""
    found = make_consistent(model_of("ur10", seconds=8.0))
    assert found.result.misfit <= found.result.chi_squared <= found.result.misfit + 0.0201 * len(found.change)
    assert found.result.chi_squared >= 0.99 * np.abs(found.change).max() ** 2
    shown = " ".join(map(str, consistent_page(found, None).parts))
    assert f"χ² {found.result.chi_squared:.1f} for" in shown


def test_as_identified_keeps_the_base_parameters():
    model = model_of("planar2")
    q, v, a = states(robot("planar2"))
    np.testing.assert_allclose(
        as_identified(model).inverse_dynamics(q, v, a), model.inverse_dynamics(q, v, a), rtol=1e-9, atol=1e-9
    )


def test_boxes_of_the_user_and_of_the_urdf():
    shape = '<collision><origin xyz="0.1 0 0"/><geometry><box size="0.3 0.2 0.2"/></geometry></collision>'
    from cases import joint, link, urdf

    machine = made(
        urdf(link("base"), link("a", 2.0, "0.1 0.02 -0.03", extra=shape), joint("j", "base", "a", axis="0 1 0"))
    )
    log = exact_log(machine, BASELINE, noise=Noise(tau=0.02))
    model = quick(machine, [log]).model
    found = make_consistent(model)
    low, high = found.boxes["j"]
    np.testing.assert_allclose([low, high], [[-0.05, -0.1, -0.1], [0.25, 0.1, 0.1]], atol=1e-9)
    assert not make_consistent(model, shapes=False).boxes
    small = make_consistent(model, boxes={"j": ((0.0, -0.1, -0.1), (0.11, 0.1, 0.1))})
    centre = small.model.links[0, 1:4] / small.model.links[0, 0]
    assert centre[0] <= 0.11 + 1e-6
    with pytest.raises(UnknownNameError):
        make_consistent(model, boxes={"k": ((0, 0, 0), (1, 1, 1))})
    with pytest.raises(InputError, match="two corners"):
        make_consistent(model, boxes={"j": ((0, 0, 0), (1, -1, 1))})


def test_a_sign_that_the_log_contradicts_is_left_and_said():
    machine = robot("planar2")
    values = random_values(machine, BASELINE) | {"fv1": -5.0}
    model = quick(machine, [exact_log(machine, BASELINE, values, noise=Noise(tau=0.01))], prior="none").model
    found = make_consistent(model)
    assert found.model.standard["fv1"] == pytest.approx(-5.0, rel=0.1)
    assert any("fv1" in n and "impossible sign" in n for n in found.notes)


# ---- use


def test_pinocchio_model_and_friction_add_up():
    machine = robot("kinova continuous")
    values = random_values(machine, BASELINE)
    model = make_consistent(quick(machine, [exact_log(machine, BASELINE, values, noise=Noise(tau=0.01))]).model).model
    q, v, a = states(machine)
    rigid = model.pinocchio()
    data = rigid.createData()
    configuration = machine.configuration(q)
    torque = np.array([pin.rnea(rigid, data, *x) for x in zip(configuration, v, a, strict=True)])
    offset = np.array([model.parameter(f"off{machine.numbers[n]}") for n in machine.joints])
    np.testing.assert_allclose(
        torque + model.friction(q, v) + offset, model.inverse_dynamics(q, v, a), rtol=1e-9, atol=1e-9
    )
    assert (np.sign(model.friction(q, v)) == np.sign(v)).all()


def test_base_parameters_alone_make_no_pinocchio_model():
    with pytest.raises(InputError, match="frischid consistent"):
        model_of("planar2").pinocchio()
