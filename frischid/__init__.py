"""frischid: identifiable dynamic parameters of a robot, their values, and how far to trust them.

    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 10, seed=1), rate=100, noise=fr.Noise(tau=0.01))
    >>> found = fr.identify(robot, [log])
    >>> found.model
    Model('planar2': 13 base parameters; viscous, coulomb, offset, rotor_inertia)

All public names are in one table, `__init__.pyi`. Type checkers and editors read the table, and `lazy_loader` imports a
name when the name is first used. So ``import frischid`` and ``frischid --help`` load neither NumPy nor Pinocchio.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
