"""How each program of the test bed is made from a Go module."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from tests.testbed import versions

# Without debug information, which takes a fifth of the time: nobody debugs these programs here.
FLAGS = ("-trimpath", "-buildvcs=false", "-mod=mod", "-gcflags=all=-dwarf=false")
STRIP = "-s -w"
COREDNS_PLUGINS = ("bind", "cache", "errors", "health", "kubernetes", "log", "ready")


@dataclass(frozen=True)
class Recipe:
    """A module, and the programs that are built from it in one go."""

    name: str
    module: str
    version: str
    commands: Mapping[str, str]  # package by name of the program; "." is `main`
    tags: str = ""
    stamps: Mapping[str, str] | None = None  # string variables of packages that say the version
    main: str = ""  # source of a main package of our own
    replaces: str = ""  # modules that the module asks for at v0.0.0 are found at this version
    minutes: float = 1.0  # on two cores, to tell who waits

    @property
    def key(self) -> str:
        """Changes with everything that goes into the programs."""
        text = json.dumps([asdict(self), versions.GO, FLAGS, STRIP], sort_keys=True)
        return f"{self.name}-{self.version}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"


def _coredns() -> str:
    packages = ["core/dnsserver", *(f"plugin/{name}" for name in COREDNS_PLUGINS)]
    imports = "\n".join(f'\t_ "github.com/coredns/coredns/{package}"' for package in packages)
    run = '\t"github.com/coredns/coredns/coremain"\n)\n\nfunc main() { coremain.Run() }\n'
    return f"package main\n\nimport (\n{imports}\n{run}"


def _kubernetes() -> Recipe:
    names = ["kube-apiserver", "kube-controller-manager", "kube-scheduler", "kubelet", "kube-proxy", "kubectl"]
    major, minor, _ = versions.KUBERNETES.split(".")
    component = "k8s.io/component-base/version"
    version = f"v{versions.KUBERNETES}"
    return Recipe(
        name="kubernetes",
        module="k8s.io/kubernetes",
        version=versions.KUBERNETES,
        commands={name: f"k8s.io/kubernetes/cmd/{name}" for name in names},
        stamps={
            f"{component}.gitVersion": version,
            f"{component}.gitMajor": major,
            f"{component}.gitMinor": minor,
            "k8s.io/client-go/pkg/version.gitVersion": version,
        },
        replaces=f"v0.{minor}.{versions.KUBERNETES.rsplit('.', 1)[1]}",
        minutes=9.0,
    )


CONTAINERD_MODULE = "github.com/containerd/containerd/v2"
RECIPES = {
    recipe.name: recipe
    for recipe in (
        _kubernetes(),
        Recipe("etcd", "go.etcd.io/etcd/server/v3", versions.ETCD, {"etcd": "go.etcd.io/etcd/server/v3"}),
        Recipe(
            "containerd",
            CONTAINERD_MODULE,
            versions.CONTAINERD,
            {name: f"{CONTAINERD_MODULE}/cmd/{name}" for name in ("containerd", "containerd-shim-runc-v2", "ctr")},
            tags="no_btrfs no_zfs no_devmapper",
            stamps={f"{CONTAINERD_MODULE}/version.Version": f"v{versions.CONTAINERD}"},
        ),
        Recipe("coredns", "github.com/coredns/coredns", versions.COREDNS, {"coredns": "."}, main=_coredns()),
        Recipe(
            "helm",
            "helm.sh/helm/v4",
            versions.HELM,
            {"helm": "helm.sh/helm/v4/cmd/helm"},
            stamps={"helm.sh/helm/v4/internal/version.version": f"v{versions.HELM}"},
        ),
        Recipe("kwok", "sigs.k8s.io/kwok", versions.KWOK, {"kwok": "sigs.k8s.io/kwok/cmd/kwok"}),
    )
}
# Built when it is asked for: only benchmarks at scale need it.
ON_REQUEST = frozenset({"kwok"})


def recipe_of(program: str) -> Recipe:
    """The recipe of a program.

    Raises:
        KeyError: no recipe makes it.
    """
    for recipe in RECIPES.values():
        if program in recipe.commands:
            return recipe
    raise KeyError(program)
