"""Nodes without machines: a stand-in for scheduler and kubelets that runs pods as processes of this computer."""
