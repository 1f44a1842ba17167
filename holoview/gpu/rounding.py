"""Integer division that rounds up: counts of workgroups, and sizes padded to whole blocks."""


def ceil_div(value: int, divisor: int) -> int:
    """⌈value / divisor⌉ for a positive divisor."""
    return -(-value // divisor)


def round_up(value: int, multiple: int) -> int:
    """The smallest multiple of `multiple` that is not less than `value`."""
    return ceil_div(value, multiple) * multiple
