"""`fleet shape` and `fleet train`."""


def shape() -> None:
    """x"""


def train() -> None:
    """x"""
