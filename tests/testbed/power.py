"""Wake-on-LAN: the magic packet, and what stands in for the network card of a machine that is off."""

from __future__ import annotations

import ctypes
import os
import socket
from pathlib import Path

from tests.testbed.network import CARD, NAMESPACES

ALL_FRAMES = 0x0003  # ETH_P_ALL, linux/if_ether.h
NEW_NETWORK = 0x40000000  # CLONE_NEWNET, linux/sched.h
PORT = 9  # the usual one; cards look at the payload only


def magic_packet(mac: str) -> bytes:
    """Six bytes of ones, and the hardware address sixteen times."""
    return b"\xff" * 6 + bytes.fromhex(mac.replace(":", "")) * 16


def send_magic_packet(mac: str, broadcast: str) -> None:
    """Wake the machine with this hardware address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sender.sendto(magic_packet(mac), (broadcast, PORT))


class Card:
    """The card of a machine that is off: it hears frames without having an address."""

    def __init__(self, namespace: str, mac: str) -> None:
        self._magic = magic_packet(mac)
        self._socket = _socket_in(namespace)

    def fileno(self) -> int:
        """To wait on it."""
        return self._socket.fileno()

    def woken(self) -> bool:
        """Whether the frame that has come is for this card."""
        frame, sender = self._socket.recvfrom(65535)
        return sender[2] != socket.PACKET_OUTGOING and self._magic in frame

    def close(self) -> None:
        """Hear no more."""
        self._socket.close()


def _socket_in(namespace: str) -> socket.socket:
    """A raw socket in another network namespace; this process stays in its own."""
    library = ctypes.CDLL(None, use_errno=True)
    own = os.open("/proc/self/ns/net", os.O_RDONLY)
    other = os.open(Path(NAMESPACES / namespace), os.O_RDONLY)
    try:
        if library.setns(other, NEW_NETWORK):
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {namespace}")
        try:
            raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_FRAMES))
            raw.bind((CARD, 0))
            return raw
        finally:
            if library.setns(own, NEW_NETWORK):
                raise OSError(ctypes.get_errno(), "cannot come back from another network namespace")
    finally:
        os.close(own)
        os.close(other)
