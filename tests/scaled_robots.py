"""The same robot in other units, or a similar one of another size: a URDF with every length, mass and time scaled."""

import xml.etree.ElementTree as ET

import numpy as np

from frischid.robot.robot import Robot

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def scaled(robot, length, mass, time=1.0):
    """A robot whose lengths, masses and times are multiplied; gravity is multiplied by ``length / time²``."""
    root = ET.fromstring(robot.urdf)
    slides = {joint.get("name"): joint.get("type") == "prismatic" for joint in root.findall("joint")}
    robot_has_damping = any(
        damping for damping, _ in robot.dynamics.values()
    )  # not where it is a simulator's, which counts as 0
    for link in root.findall("link/inertial"):
        _multiply(link.find("mass"), mass, "value")
        _multiply(link.find("inertia"), mass * length**2, *INERTIA)
        _multiply(link.find("origin"), length, "xyz")
    for joint in root.findall("joint"):
        sliding = slides[joint.get("name")]
        own = length if sliding else 1.0
        force = mass * length / time**2 * (1.0 if sliding else length)
        _multiply(joint.find("origin"), length, "xyz")
        _multiply(joint.find("limit"), own, "lower", "upper")
        _multiply(joint.find("limit"), own / time, "velocity")
        _multiply(joint.find("limit"), force, "effort")
        _multiply(joint.find("dynamics"), force / (own / time) * robot_has_damping, "damping")
        _multiply(joint.find("dynamics"), force, "friction")
        mimic = joint.find("mimic")
        if mimic is not None:
            leads = length if slides[mimic.get("joint")] else 1.0
            mimic.set("multiplier", repr(float(float(mimic.get("multiplier", 1.0)) * own / leads)))
            _multiply(mimic, own, "offset")
    gravity = tuple(float(g) * length / time**2 for g in robot.gravity)
    return Robot(robot.name, robot.source, ET.tostring(root, encoding="unicode"), gravity)


def torque_factor(robot, length, mass, time=1.0):
    """Factor of each joint's torque (force), shape (J,)."""
    return mass * length**2 / time**2 / np.where(robot.prismatic, length, 1.0)


def _multiply(element, factor, *names):
    """Multiply attributes of an element, where there are any."""
    for name in names:
        if element is not None and element.get(name) is not None:
            values = [repr(float(float(x) * factor)) for x in element.get(name).split()]
            element.set(name, " ".join(values))
