"""Text that others made, such as names in files: shown as it is read, never obeyed."""


def printable(text: str, keep: str = "") -> str:
    r"""A text in which all is seen: what steers a terminal, turns the direction of writing or shows nothing is escaped.

    Args:
        text: Any.
        keep: Characters that stay, such as ends of lines.

    Returns:
        The text, ``\\\\x1b`` for an escape character, ``\\\\n`` for an end of line, ``\\\\u202e`` for an override.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)
