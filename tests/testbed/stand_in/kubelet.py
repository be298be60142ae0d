"""The loop that does for a few fake nodes what a scheduler and kubelets do: bind, start, watch, report, remove."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections.abc import Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Any

from fleet_operator.local.workloads import UnsupportedManifest
from tests.testbed.stand_in.api import MERGE, Api, Mirror, Refused
from tests.testbed.stand_in.binding import Binder, path_of
from tests.testbed.stand_in.entries import Entry, with_replaced
from tests.testbed.stand_in.forks import Nurseries
from tests.testbed.stand_in.node import Shape, keep_alive, register
from tests.testbed.stand_in.orders import Orders
from tests.testbed.stand_in.places import Places
from tests.testbed.stand_in.pods import RunningPod, job_of, missing_image
from tests.testbed.stand_in.statuses import View, now, status_of

Manifest = dict[str, Any]
_STEP_S = 0.02
_LOOK_AGAIN_S = 0.2
_OVER = {"Succeeded", "Failed"}


class Kubelet:
    """Runs the pods of some fake nodes.

    Args:
        folder: Of logs, volumes, `journal.jsonl` (one line for each start and end of a pod) and `orders.json`.
        replace: Texts that are replaced in the values of environment variables.
    """

    def __init__(
        self, api: Api, nurseries: Nurseries, folder: Path, shapes: Sequence[Shape], replace: Mapping[str, str]
    ) -> None:
        self._api = api
        self._nurseries = nurseries
        self._folder = folder
        self._shapes = shapes
        self._replace = replace
        self._names = {shape.name for shape in shapes}
        self._mirrors = [Mirror(api, f"/api/v1/{kind}", self._touch) for kind in ("pods", "nodes", "services")]
        self._pods, self._nodes, self._services = self._mirrors
        self._places = Places(api, folder / "volumes")
        self._binder = Binder(api, self._spawn)
        self._orders = Orders(folder / "orders.json")
        self._journal = (folder / "journal.jsonl").open("a")
        self._entries: dict[str, Entry] = {}
        self._removed: set[str] = set()
        self._numbers = 0
        self._changed = True
        self._tasks: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Work until it is cancelled."""
        for shape in self._shapes:
            await register(self._api, shape)
        for mirror in self._mirrors:
            self._spawn(mirror.run())
        self._spawn(keep_alive(self._api, self._shapes, lambda node: node in self._orders.dark_nodes))
        for mirror in self._mirrors:
            await mirror.listed.wait()
        (self._folder / "ready").touch()
        try:
            while True:
                self._step()
                await asyncio.sleep(_STEP_S)
        finally:
            for task in self._tasks:
                task.cancel()

    def close(self) -> None:
        """End every process."""
        deadline = time.monotonic() + 2
        while time.monotonic() < deadline and not all(each.has_ended for each in self._entries.values()):
            for entry in self._entries.values():
                if entry.running is not None:
                    entry.running.stop(0)
                    entry.running.step()
            time.sleep(_STEP_S)
        self._nurseries.close()
        self._places.close()

    def _touch(self) -> None:
        self._changed = True

    def _step(self) -> None:
        if self._orders.read() or self._changed:
            self._changed = False
            self._follow()
            self._binder.schedule([*self._pods], [node for node in self._nodes if self._is_usable(node)])
        for entry in list(self._entries.values()):
            if entry.node in self._orders.dark_nodes:
                self._lose(entry)
            else:
                self._advance(entry)
                self._report(entry)

    def _is_usable(self, node: Manifest) -> bool:
        name = node["metadata"]["name"]
        return name in self._names and name not in self._orders.dark_nodes and "allocatable" in node["status"]

    def _follow(self) -> None:
        """Take up new pods, hear of deletions, notice those that are gone."""
        present = set()
        for pod in self._pods:
            uid, node = pod["metadata"]["uid"], pod["spec"].get("nodeName")
            if node not in self._names:
                continue
            present.add(uid)
            if uid in self._entries:
                self._entries[uid].manifest = pod
            elif node not in self._orders.dark_nodes and uid not in self._removed:
                self._take_up(pod)
        self._removed &= present
        for uid, entry in self._entries.items():
            entry.gone = entry.gone or uid not in present

    def _take_up(self, pod: Manifest) -> None:
        """A new pod; of those that have ended, only what waits to be removed."""
        uid, status = pod["metadata"]["uid"], pod["status"]
        if status.get("phase") in _OVER:
            over = View(status["phase"])
            if "deletionTimestamp" in pod["metadata"]:
                self._entries[uid] = Entry(pod, 0, view=over, reported=over)
        elif any("running" in each["state"] for each in status.get("containerStatuses", ())):
            # It ran before the machine lost its power; with restartPolicy Never it is not started again.
            self._entries[uid] = Entry(pod, 0, view=View("Failed", code=137))
        else:
            self._numbers += 1
            self._entries[uid] = Entry(pod, self._numbers)

    def _lose(self, entry: Entry) -> None:
        """The node has no power: processes end at once, and nobody says so."""
        if entry.running is not None and not entry.running.stopped:
            entry.running.stop(0)
            entry.running.step()
        if entry.has_ended and not entry.preparing:
            if entry.running is not None and not entry.view.over:
                self._note(entry, "ended", code=137)
            self._give_back(entry)
            del self._entries[entry.uid]
            self._changed = True

    def _advance(self, entry: Entry) -> None:
        running = entry.running
        if running is None:
            if entry.view.over or entry.preparing:
                return
            if entry.leaving:
                entry.view = View("Failed", message="the pod was deleted before it started", code=137)
            else:
                entry.preparing = True
                self._spawn(self._prepare(entry))
        elif not running.stopped:
            if entry.leaving:
                running.stop(0 if entry.gone else entry.manifest["metadata"].get("deletionGracePeriodSeconds", 0))
            running.step()
            entry.view = running.view()
            if running.stopped:
                self._note(entry, "ended", code=entry.view.code)
                self._give_back(entry)

    async def _prepare(self, entry: Entry) -> None:
        """Wait for the image, volumes and ports, then start."""
        try:
            entry.view = await self._begun(entry)
        except UnsupportedManifest as error:
            entry.view = View(waiting="CreateContainerConfigError", message=str(error))
        if entry.view.waiting:
            await asyncio.sleep(_LOOK_AGAIN_S)
        entry.preparing = False

    async def _begun(self, entry: Entry) -> View:
        """Start a pod, or say what hinders it."""
        missing = missing_image(entry.manifest, self._orders.missing_images)
        if missing is not None:
            return View(waiting=missing[0], message=missing[1])
        job = job_of(entry.manifest)
        volumes = await self._places.volumes_of(job)
        if volumes is None:
            return View(waiting="ContainerCreating", message="MountVolume.SetUp failed: configmap not found")
        address = entry.place.address if entry.place is not None else ""
        entry.place = self._places.take(job, entry.number, self._services, volumes, address)
        if not self._places.is_free(entry.place):
            return View(waiting="ContainerCreating", message=f"{entry.place.address} is still another pod's")
        if entry.leaving or entry.node in self._orders.dark_nodes:
            return View()
        manifest = with_replaced(entry.manifest, self._replace)
        logs = self._folder / "logs" / job.namespace

        def died(container: str, reason: str) -> None:
            self._note(entry, "restarted", container=container, reason=reason)

        entry.started = now()
        entry.running = RunningPod(manifest, entry.place, self._nurseries.of(manifest), logs, died)
        entry.running.step()
        self._note(entry, "started")
        return entry.running.view()

    def _give_back(self, entry: Entry) -> None:
        if entry.place is not None:
            self._places.give_back(entry.place, job_of(entry.manifest), entry.number)
        entry.place = None

    def _report(self, entry: Entry) -> None:
        """Say what is new; remove a pod that was deleted and has ended."""
        if entry.call is not None and not entry.call.done():
            return
        if entry.gone:
            if entry.has_ended and not entry.preparing:
                self._give_back(entry)
                del self._entries[entry.uid]
        elif entry.reported != entry.view:
            entry.call = self._spawn(self._say(entry, entry.view))
        elif entry.leaving and entry.view.over:
            entry.call = self._spawn(self._remove(entry))

    async def _say(self, entry: Entry, view: View) -> None:
        address = entry.place.address if entry.place is not None else ""
        status = status_of(entry.manifest, view, address, entry.started or now())
        body = {"metadata": {"uid": entry.uid}, "status": status}
        try:
            await self._api.call("PATCH", f"{path_of(entry.manifest)}/status", body, MERGE)
        except Refused as error:
            if error.status not in {404, 409}:
                raise
            entry.gone = error.status == 404 or entry.gone
        entry.reported = view

    async def _remove(self, entry: Entry) -> None:
        options = {"gracePeriodSeconds": 0, "preconditions": {"uid": entry.uid}}
        with contextlib.suppress(Refused):
            await self._api.call("DELETE", path_of(entry.manifest), options)
        # The Job controller's finalizer may keep the object for a while; there is nothing left to do for it here.
        self._removed.add(entry.uid)
        entry.gone = True

    def _note(self, entry: Entry, event: str, **more: Any) -> None:
        metadata = entry.manifest["metadata"]
        line = {
            "time": time.time(),
            "event": event,
            "namespace": metadata["namespace"],
            "job": next((each["name"] for each in metadata.get("ownerReferences", ()) if each.get("controller")), ""),
            "pod": metadata["name"],
            "uid": metadata["uid"],
            "node": entry.node,
            "pids": [] if entry.running is None else entry.running.pids,
            "labels": metadata.get("labels", {}),
            **more,
        }
        self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()

    def _spawn(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)
        return task

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            sys.stderr.write(f"a call of the stand-in kubelet failed: {task.exception()!r}\n")
        self._changed = True
