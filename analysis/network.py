"""The two networks that find the face, run by LiteRT where it is installed, else by OpenCV.

Both give the same points to 1e-4 of a pixel; LiteRT, which is in the extra ``fast``, takes 0.7 ms a
face mesh on one core where OpenCV's DNN takes 1.9.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import ModelError

F32 = npt.NDArray[np.float32]


class Network:
    """A network from pictures to numbers, on one core.

    Parameters
    ----------
    path : path
        TensorFlow Lite model.
    outputs : sequence of str
        Names of the outputs that are wanted.

    Raises
    ------
    ModelError
        If the file is no such model.
    """

    def __init__(self, path: object, outputs: Sequence[str]) -> None:
        self._outputs = list(outputs)
        self._interpreter: Any = None
        with suppress(ImportError):
            litert = importlib.import_module("ai_edge_litert.interpreter")
            try:
                with _silence():
                    self._interpreter = litert.Interpreter(str(path), num_threads=1)
                    self._interpreter.allocate_tensors()
            except (ValueError, RuntimeError) as error:
                said = str(error).splitlines() or ["unknown reason"]
                raise ModelError(f"{path}: LiteRT cannot load it ({said[0]})") from error
            places = {d["name"]: d["index"] for d in self._interpreter.get_output_details()}
            if not set(self._outputs) <= set(places):
                raise ModelError(f"{path}: is another model, without {', '.join(self._outputs)}")
            self._places = [places[name] for name in self._outputs]
            self._input = self._interpreter.get_input_details()[0]["index"]
            return
        try:
            # The classic engine: OpenCV 5's new one loses every output but the last.
            self._network = cv2.dnn.readNetFromTFLite(str(path), cv2.dnn.ENGINE_CLASSIC)
        except cv2.error as error:
            raise ModelError(f"{path}: OpenCV cannot load it ({error.err or error})") from error

    def run(self, picture: F32) -> list[F32]:
        """Outputs for a picture, each flattened.

        Parameters
        ----------
        picture : (h, w, 3) float32
            RGB at the network's size, in its range.
        """
        if self._interpreter is not None:
            self._interpreter.set_tensor(self._input, picture[None])
            self._interpreter.invoke()
            found = [self._interpreter.get_tensor(place) for place in self._places]
        else:
            self._network.setInput(cv2.dnn.blobFromImage(picture))
            found = list(self._network.forward(self._outputs))
        return [values.reshape(-1) for values in found]


@contextmanager
def _silence() -> Iterator[None]:
    """Keep off the terminal the line by which LiteRT says which kernels it took."""
    try:
        kept = os.dup(2)
    except OSError:  # Nobody listens there.
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
