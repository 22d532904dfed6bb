"""One source's frames on their way into a map, across cut connections."""

import queue
import random
import threading
import time

import grpc

from clearance.errors import ClearanceError
from clearance.v1 import ingest_pb2

_RETRY = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED, grpc.StatusCode.INTERNAL)


class _Session:
    """One open IngestFrames call."""

    def __init__(self, stub, opening, on_ack, timeout_s):
        self._outgoing = queue.SimpleQueue()
        self._changed = threading.Condition()
        self._credits = 0
        self._opened = False
        self._ended = None
        self._on_ack = on_ack
        self.last_frame_id = None
        self._call = stub.IngestFrames(iter(self._outgoing.get, None))
        self._outgoing.put(ingest_pb2.IngestFramesRequest(open=opening))
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.wait(lambda: self._opened, timeout_s)

    def _read(self):
        try:
            for response in self._call:
                kind = response.WhichOneof("message")
                if kind == "ack":
                    self._on_ack(response.ack)
                with self._changed:
                    if kind == "opened":
                        self._opened = True
                        self._credits += response.opened.credits.frames
                        if response.opened.HasField("last_frame_id"):
                            self.last_frame_id = response.opened.last_frame_id
                    elif kind == "credit":
                        self._credits += response.credit.frames
                    self._changed.notify_all()
            ended = (grpc.StatusCode.UNAVAILABLE, "the server ended the stream")
        except grpc.RpcError as error:
            ended = (error.code(), error.details())
        with self._changed:
            self._ended = ended
            self._changed.notify_all()

    def wait(self, condition, timeout_s):
        """Until the condition holds; raises what ended the stream."""
        with self._changed:
            done = self._changed.wait_for(lambda: condition() or self._ended, timeout_s)
            if condition():
                return
            if not done:
                raise ClearanceError(grpc.StatusCode.DEADLINE_EXCEEDED,
                                     f"the server said nothing for {timeout_s:g} s")
            raise ClearanceError(*self._ended)

    def send(self, frame, timeout_s):
        self.wait(lambda: self._credits > 0, timeout_s)
        with self._changed:
            self._credits -= 1
        self._outgoing.put(ingest_pb2.IngestFramesRequest(frame=frame))

    def close(self):
        self._outgoing.put(None)

    def cancel(self):
        self._outgoing.put(None)
        self._call.cancel()
        self._thread.join()


class IngestStream:
    """Sends frames as credits allow; reconnects and sends again what was not settled.

    `last_frame_id` is the newest settled frame (None where there is none): continue behind it.
    Use as a context manager: leaving it waits until every frame is settled.
    """

    def __init__(self, stub, map, source_id, max_range_m, reconnect_for_s=30.0, timeout_s=60.0):
        self._stub = stub
        self._opening = ingest_pb2.OpenIngest(
            map=map, source_id=source_id, max_range_m=max_range_m)
        self._reconnect_for_s = reconnect_for_s
        self._timeout_s = timeout_s
        self._lock = threading.Lock()
        self._pending = {}
        self._session = None
        self.acks = []
        self.last_frame_id = None
        self._open()

    def send(self, frame):
        """Sends a Frame message; waits for credit. Frame ids rise."""
        with self._lock:
            self._pending[frame.frame_id] = frame
        try:
            self._session.send(frame, self._timeout_s)
        except ClearanceError as error:
            self._recover(error)

    def finish(self):
        """Waits until every frame is settled and closes the stream; returns all acks."""
        while True:
            try:
                self._session.wait(lambda: not self._pending, self._timeout_s)
                break
            except ClearanceError as error:
                self._recover(error)
        self._session.close()
        return self.acks

    def __enter__(self):
        return self

    def __exit__(self, error_type, *_):
        if error_type is None:
            self.finish()
        else:
            self._session.cancel()

    def _open(self):
        self._session = _Session(self._stub, self._opening, self._on_ack, self._timeout_s)
        self.last_frame_id = self._session.last_frame_id
        with self._lock:
            if self.last_frame_id is not None:
                self._pending = {k: f for k, f in self._pending.items() if k > self.last_frame_id}

    def _on_ack(self, ack):
        if ack.status != ingest_pb2.INGEST_STATUS_ACCEPTED:
            with self._lock:
                self._pending.pop(ack.frame_id, None)
                self.last_frame_id = max(self.last_frame_id or 0, ack.frame_id)
        self.acks.append(ack)

    def _recover(self, error):
        """Opens a new stream and sends what is pending again, until it works or time is up."""
        give_up = time.monotonic() + self._reconnect_for_s
        backoff_s = 0.1
        retry = error.code in _RETRY
        while retry and time.monotonic() < give_up:
            self._session.cancel()
            # Jitter: many clients of a restarted server do not come back at once.
            time.sleep(backoff_s * random.uniform(0.5, 1.0))
            backoff_s = min(2 * backoff_s, 5.0)
            try:
                self._open()
                with self._lock:
                    again = list(self._pending.values())
                for frame in again:
                    self._session.send(frame, self._timeout_s)
                return
            except ClearanceError as next_error:
                error = next_error
                # The server may not have given up the cut stream of this source yet.
                retry = error.code in (*_RETRY, grpc.StatusCode.FAILED_PRECONDITION)
        raise error
