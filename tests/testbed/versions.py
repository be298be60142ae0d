"""Versions of everything that the test bed is made of; a change of one builds it anew."""

from __future__ import annotations

KUBERNETES = "1.37.2"
ETCD = "3.7.3"
CONTAINERD = "2.4.2"
COREDNS = "1.15.0"
HELM = "4.3.1"
KWOK = "0.8.0"
HADOOP = "3.5.0"
GO = "1.26.0"
