# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout without a window: source text for scripts that run in a Blender of their own."""

STUB_LAYOUT = '''
from types import SimpleNamespace


class Layout:
    """Takes the calls of a panel; looks up each property, enum item and operator that it names."""

    def __init__(self, drawn=None, parent=None):
        kinds = ("properties", "operators", "labels", "greyed")
        self.drawn = {kind: [] for kind in kinds} if drawn is None else drawn
        self.active = self.enabled = True
        self.parent = parent

    def is_on(self):
        return self.active and self.enabled and (self.parent is None or self.parent.is_on())

    def child(self, **_):
        return Layout(self.drawn, self)

    row = column = box = grid_flow = split = child

    def note(self, name):
        if not self.is_on():
            self.drawn["greyed"].append(name)

    def prop(self, data, name, **_):
        getattr(data, name)
        self.drawn["properties"].append(name)
        self.note(name)

    def prop_enum(self, data, name, value, **_):
        assert value in data.bl_rna.properties[name].enum_items.keys(), value
        self.drawn["properties"].append(name)
        self.note(value)

    def operator(self, name, **_):
        family, _, verb = name.partition(".")
        getattr(getattr(bpy.ops, family), verb).get_rna_type()
        self.drawn["operators"].append(name)
        return SimpleNamespace()

    def progress(self, **_):
        pass

    def label(self, text="", **_):
        if text:
            self.drawn["labels"].append(text)

    def popover(self, panel, **_):
        assert hasattr(bpy.types, panel), panel


def draw(name, context=None):
    """Draw a panel; return what it drew."""
    panel = getattr(bpy.types, name)
    layout = Layout()
    plain = {key: value for cls in reversed(panel.__mro__[:-1]) for key, value in vars(cls).items()
             if key.startswith(("draw", "_")) and callable(value) and not key.startswith("__")
             or key in ("group", "settings_type")}
    this = type("This", (), plain)()
    this.layout = layout
    for method in ("draw_header", "draw_header_preset", "draw"):
        if method in plain:
            getattr(this, method)(context or bpy.context)
    return layout.drawn


def our_panels():
    return [name for name in dir(bpy.types) if name.startswith("SSGI_PT_") and name != "SSGI_PT_presets"]
'''
