"""Places of XML elements: what has no place of its own is refused, and no file ends in a traceback."""

import pytest

from frischid.errors import InputError
from frischid.robot.xml_places import DEEPEST_ELEMENT, elements


def test_an_element_from_an_entity_has_no_place():
    """Its tag would be that of the next element; an odd quote behind it had ended in an AssertionError."""
    for rest in ("<!-- this arm isn't mine -->", '<link name="a"/>'):
        text = f"""<!DOCTYPE robot [<!ENTITY m "<material name='x'/>">]>\n<robot name="r">&m;{rest}</robot>"""
        with pytest.raises(InputError, match=r"arm.urdf, line 2: <material> comes from an entity; write the element"):
            elements(text.encode(), "arm.urdf")


def test_an_entity_in_a_value_is_read():
    text = """<!DOCTYPE robot [<!ENTITY n "arm">]><robot name="&n;"><link name="a > b"/></robot>"""
    robot = elements(text.encode(), "arm.urdf")
    assert robot.attributes == {"name": "arm"}
    assert text[slice(*robot.children[0].tag)] == '<link name="a > b"/>'


@pytest.mark.parametrize(("depth", "refused"), [(DEEPEST_ELEMENT - 1, False), (DEEPEST_ELEMENT, True)])
def test_elements_are_nested_up_to_a_limit(depth, refused):
    data = ("<robot>" + "<a>" * depth + "</a>" * depth + "</robot>").encode()
    if refused:
        with pytest.raises(InputError, match=r"arm.urdf, line 1: elements are nested more than 500 deep"):
            elements(data, "arm.urdf")
    else:
        assert len(list(elements(data, "arm.urdf").below())) == depth
