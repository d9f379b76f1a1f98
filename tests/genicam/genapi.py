"""A camera's features as GenICam's own reference implementation reads them from the same description and registers, against
what `plenalign camera controls --json` says: genapi.py ADDRESS FILE

Prints how many features were compared, how many of them have limits, and how many a unit.
"""

import json
import math
import pathlib
import sys

import gvcp
from genicam import genapi

camera = gvcp.Client(sys.argv[1])


class Registers(genapi.AbstractPort):
    """The camera's registers, to be read."""

    def read(self, address, length):
        return camera.memory(address, length)

    def write(self, address, data):
        raise AssertionError(f"{address:#x} is written")

    def get_access_mode(self):
        return genapi.EAccessMode.RW

    def is_open(self):
        return True


def near(one, other):
    return math.isclose(one, other, rel_tol=1e-12, abs_tol=1e-12)


def entries(node):
    """Of an enumeration, what it takes now."""
    available = [entry for entry in node.entries if genapi.is_available(entry.node.get_access_mode())]
    return sorted(entry.symbolic for entry in available)


def compare(node, ours):
    mode = node.node.get_access_mode()
    kind = type(node).__name__
    assert genapi.is_writable(mode) == (ours["locked"] is None), (mode, ours)
    if kind in ("IInteger", "IFloat"):
        assert near(node.value, ours["value"]), (node.value, ours)
        if ours["minimum"] is None:
            # None is declared: what the register holds.
            assert node.min in (0, -(2**31), -(2**63)) and node.max >= 2**31 - 1, (node.min, node.max, ours)
        else:
            assert near(node.min, ours["minimum"]) and near(node.max, ours["maximum"]), (node.min, node.max, ours)
        assert (node.unit or None) == ours["unit"], (node.unit, ours)
        if kind == "IInteger":
            assert near(node.inc, ours["step"] or 1), (node.inc, ours)
        else:
            assert node.has_inc() == (ours["step"] is not None), ours
    elif kind == "IEnumeration":
        assert node.value == ours["value"], (node.value, ours)
        assert entries(node) == sorted(ours["items"]), (entries(node), ours)
    elif kind in ("IBoolean", "IString"):
        assert node.value == ours["value"], (node.value, ours)
    else:
        assert kind in ("ICommand", "IRegister"), kind
        assert ours["value"] is None, ours


def shown(category):
    """What a category shows, in itself or in those that it has."""
    for feature in category.features:
        if isinstance(feature, genapi.ICategory):
            yield from shown(feature)
        elif genapi.is_implemented(feature.node.get_access_mode()):
            yield feature.node.name


def main():
    nodes = genapi.NodeMap()
    nodes.load_xml_from_string(camera.description())
    registers = Registers()
    nodes.connect(registers, "Device")
    ours = {feature["key"]: feature for feature in json.loads(pathlib.Path(sys.argv[2]).read_text())["controls"]}
    missing = set(shown(nodes.get_node("Root"))) - set(ours)
    assert not missing, f"not listed: {missing}"
    for name, feature in ours.items():
        compare(nodes.get_node(name), feature)
    limited = [feature for feature in ours.values() if feature["minimum"] is not None]
    print(len(ours), len(limited), len([feature for feature in ours.values() if feature["unit"]]))


main()
