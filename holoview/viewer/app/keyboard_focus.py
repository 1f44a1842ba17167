"""Panels and their widgets by keys alone: F6 goes to the next panel, Tab and the arrows from widget to widget.

While widgets have the keys, a frame in the colour of the accent stands around the one that has them, arrows, Space,
Enter and Escape are theirs, and all other keys stay commands. Escape and any click of the pointer end it.
"""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import hello_imgui, imgui

Key = imgui.Key
OF_WIDGETS = frozenset(
    key.value
    for key in (
        Key.left_arrow,
        Key.right_arrow,
        Key.up_arrow,
        Key.down_arrow,
        Key.space,
        Key.enter,
        Key.escape,
        Key.tab,
        Key.page_up,
        Key.page_down,
        Key.home,
        Key.end,
    )
)
"""Keys that are no commands while widgets have the keys."""
_TO_FRONT = 3  # frames until a panel that was behind others can take the keys
_FLAG = imgui.ConfigFlags_.nav_enable_keyboard.value


class KeyboardFocus:
    """Whether a panel and its widgets have the keys, and which one.

    show_panel: brings the panel of a title to the front. titles: of all panels, in their order. wake: has a frame
    drawn.
    """

    def __init__(
        self, show_panel: Callable[[str], None], titles: Callable[[], list[str]], wake: Callable[[], None]
    ) -> None:
        self._show_panel, self._titles, self._wake = show_panel, titles, wake
        self.panel, self._frames = "", 0

    @property
    def is_on(self) -> bool:
        """Whether a panel has the keys."""
        return bool(imgui.get_io().config_flags & _FLAG)

    @property
    def is_on_widget(self) -> bool:
        """Whether a widget has the keys, which a panel like that of the image hasn't."""
        return self.is_on and imgui.get_io().nav_visible

    def go(self, step: int) -> None:
        """Gives the keys to the panel that is `step` open panels further on; from the last one to the first."""
        docking = hello_imgui.get_runner_params().docking_params
        windows = [(title, docking.dockable_window_of_name(title)) for title in self._titles()]
        titles = [title for title, window in windows if window is not None and window.is_visible]
        if not titles:
            return
        place = titles.index(self.panel) + step if self.panel in titles else min(step - 1, 0)
        self.panel = titles[place % len(titles)]
        imgui.get_io().config_flags |= _FLAG
        self._frames = _TO_FRONT
        self._show_panel(self.panel)

    def begin_frame(self, *, is_typing: bool) -> bool:
        """Takes the keys that begin and end it; returns whether Escape is used up."""
        if not self.is_on:
            if imgui.is_key_pressed(Key.tab, repeat=False) and not is_typing and not imgui.get_io().key_ctrl:
                self.go(0 if self.panel else 1)
            return False
        is_clicked = any(imgui.is_mouse_clicked(button) for button in range(imgui.MouseButton_.count))
        is_left = imgui.is_key_pressed(Key.escape, repeat=False) and not imgui.is_any_item_active()
        if is_clicked or is_left:
            imgui.get_io().config_flags &= ~_FLAG
            imgui.set_nav_cursor_visible(False)
        elif self._frames:
            self._frames -= 1
            self._wake()
            window = imgui.internal.find_window_by_name(self.panel)
            if not self._frames and window is not None:
                imgui.internal.focus_window(window)  # itself, and none of its parts, which may have had the keys before
                imgui.internal.nav_init_window(window, True)  # its first widget
                imgui.set_nav_cursor_visible(True)
        return is_left
