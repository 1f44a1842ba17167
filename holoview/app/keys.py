"""Keys: from the names in events of browsers and windows to those of ImGui, and chords such as "Ctrl+Shift+Z"."""

from __future__ import annotations

from dataclasses import dataclass

from imgui_bundle import imgui

Key = imgui.Key

_NAMED = {
    "ArrowDown": Key.down_arrow,
    "ArrowUp": Key.up_arrow,
    "ArrowLeft": Key.left_arrow,
    "ArrowRight": Key.right_arrow,
    "Backspace": Key.backspace,
    "Delete": Key.delete,
    "End": Key.end,
    "Enter": Key.enter,
    "Escape": Key.escape,
    "Home": Key.home,
    "Insert": Key.insert,
    "PageDown": Key.page_down,
    "PageUp": Key.page_up,
    "Tab": Key.tab,
    "Alt": Key.left_alt,
    "Control": Key.left_ctrl,
    "Shift": Key.left_shift,
    "Meta": Key.left_super,
    " ": Key.space,
    "=": Key.equal,
    "+": Key.equal,
    "-": Key.minus,
    "_": Key.minus,
    ",": Key.comma,
    "<": Key.comma,
    ".": Key.period,
    ">": Key.period,
    "/": Key.slash,
    "?": Key.slash,
    ";": Key.semicolon,
    "'": Key.apostrophe,
    "[": Key.left_bracket,
    "]": Key.right_bracket,
    "\\": Key.backslash,
    "`": Key.grave_accent,
    **{f"F{n}": Key(Key.f1.value + n - 1) for n in range(1, 13)},
    **{str(n): Key(Key._0.value + n) for n in range(10)},
    **{chr(ord("a") + n): Key(Key.a.value + n) for n in range(26)},
}
_MODIFIERS = {
    "Shift": Key.mod_shift,
    "Control": Key.mod_ctrl,
    "Ctrl": Key.mod_ctrl,
    "Alt": Key.mod_alt,
    "Meta": Key.mod_super,
}
_SPOKEN = {"Space": " ", "Left": "ArrowLeft", "Right": "ArrowRight", "Up": "ArrowUp", "Down": "ArrowDown"}


def key_named(name: str) -> Key | None:
    """ImGui's key for an event's key name; None for keys that aren't used."""
    return _NAMED.get(name) or _NAMED.get(name.lower())


def modifier_named(name: str) -> Key | None:
    """ImGui's modifier for the name of a modifier key; None for other keys."""
    return _MODIFIERS.get(name)


@dataclass(frozen=True)
class Chord:
    """A key with modifiers, written as "Ctrl+Z", "Shift+Left" or "?"."""

    text: str

    @property
    def parts(self) -> tuple[tuple[str, ...], str]:
        """Names of the modifiers and of the key, as events have them."""
        *modifiers, key = self.text.split("+") if self.text != "+" else ["+"]
        return tuple("Control" if name == "Ctrl" else name for name in modifiers), _SPOKEN.get(key, key)

    @property
    def code(self) -> int:
        """ImGui's code of the key chord."""
        modifiers, name = self.parts
        key = key_named(name)
        assert key is not None, f"no key is called {name}"
        extra = {Key.mod_shift.value} if name == "?" else set()
        return int(sum({_MODIFIERS[modifier].value for modifier in modifiers} | extra)) | key.value

    def is_down(self) -> bool:
        """Whether its key is held down, with any modifiers."""
        return imgui.is_key_down(Key(self.code & ~Key.mod_mask_.value))

    def was_pressed(self, repeat: bool = False) -> bool:
        """Whether exactly this chord was pressed since the last frame."""
        code = self.code
        io = imgui.get_io()
        held = sum(
            mask.value
            for is_down, mask in (
                (io.key_ctrl, Key.mod_ctrl),
                (io.key_shift, Key.mod_shift),
                (io.key_alt, Key.mod_alt),
                (io.key_super, Key.mod_super),
            )
            if is_down
        )
        mask = Key.mod_mask_.value
        return (code & mask) == held and imgui.is_key_pressed(Key(code & ~mask), repeat)
