"""A URDF that cannot be used is refused with the joint or link that is wrong."""

import pytest

from frischid.errors import InputError
from frischid.robot.robot import Robot

LINKS = (
    '<link name="a"/><link name="b"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
ENDS = '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
LIMIT = '<limit effort="1" velocity="1" lower="-1" upper="1"/>'
JOINT = f'<joint name="j" type="revolute">{ENDS}{LIMIT}</joint>'


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (f'{LINKS}<joint name="j" type="revolute">{ENDS}</joint>', "joint 'j' has no <limit> with effort and velocity"),
        (f'{LINKS}<joint name="j" type="prismatic">{ENDS}<limit effort="1"/></joint>', "'j' has no <limit> with velo"),
        (LINKS + JOINT.replace("</joint>", "<dynamics/></joint>"), "<dynamics> with neither damping nor friction"),
        (LINKS + LINKS + JOINT, "the link 'a' stands twice"),
        (LINKS + JOINT.replace("revolute", "hinge"), "joint 'j' has the type 'hinge'"),
        (LINKS + JOINT.replace('parent link="a"', 'parent link="c"'), "has the parent link 'c', which the URDF does"),
        (LINKS + JOINT.replace('<parent link="a"/>', ""), "joint 'j' has no parent"),
        (LINKS + JOINT.replace('name="j" ', ""), "a joint has no name"),
        (f'{LINKS}<link name="c"/>{JOINT}', "the links a, c are the child of no joint"),
        (LINKS + JOINT + JOINT.replace('"j"', '"k"'), "the link 'b' is the child of 2 joints"),
    ],
)
def test_the_cause_is_named(inside, said, tmp_path):
    """Pinocchio says 'does not contain a valid URDF model' for all of them but the last, where a joint is lost."""
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">{inside}</robot>')
    with pytest.raises(InputError) as caught:
        Robot.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)


def test_the_same_robot_without_the_faults_is_read(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">{LINKS}{JOINT}</robot>')
    assert Robot.load(path).joints == ("j",)
