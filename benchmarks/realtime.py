"""How far from real time: rendering, a timing file to mp4, the first picture, drift.

Usage: realtime.py [DB.h5]. Uses a database of real footage, named here or in UNITSEL_BENCH_DB, else
out/demo.h5 that `make demo` leaves; speech is espeak's (the extra `espeak`).

* Rendering against a plain draw of a whole picture (uploaded, drawn, read back) by the same
  OpenGL, in turns, at 360 x 288 and 720 x 576. Pictures are decoded before, as they are when a
  video is made; then: the mouth alone drawn and read back; the whole frame, with the
  colour applied and the mouth laid over the background's planes; the same with the colour fitted.
* A minute of speech as a timing file to mp4, with its sound: the command, started as a process,
  and in a process that runs already.
* From text to the first picture: spoken, selected, drawn, by a synthesizer that has done it before.
* Drift: clicks at the utterances' starts in a minute of sound, against the time stamps of their
  first pictures, at five frame rates, the background's stamps being uneven.

Times are wall time on the machine as it is, and, where it says cpu, of all threads together.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import av
import moderngl
import numpy as np

import unitsel
from database.errors import SpeechError
from database.media import read_sound, read_video
from database.sound import Sound
from database.timing import Timing, write_timing
from render.blend import blend_alpha
from render.colour_transfer import ColourTransfer
from render.compose import composite, cut_from_planes
from render.playback import Playback
from render.scene import Scene, start_opengl
from unitsel.placed import Placed
from unitsel.select import Selection
from unitsel.speech.spoken import speak
from unitsel.unit_pictures import UnitPictures

TEXT = (
    "The weather stayed fine for most of the week, and nobody thought of going home. "
    "We walked along the river every morning, bought bread and apples, and talked about the old "
    "bridge. On Friday a strong wind came up from the west. Five boats broke loose, and the ferry "
    "could not leave before noon. My brother paid the captain twice, which made him very happy. "
)
SENTENCES = [
    "Please set the blue one now.",
    "I would like to say something else, and then go home.",
    "Good morning!",
    "How many people live in your part of the town?",
    "She bought five pounds of apples, which were far too many for the cake.",
]
SIZES = ((360, 288), (720, 576))
RATES = (25.0, 29.97, 30.0, 50.0, 59.94)
ROUNDS = 60

QUAD = """
#version 330
in vec2 corner;
out vec2 place;
void main() { gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0); place = corner; }
"""
FILL = """
#version 330
uniform sampler2D picture;
in vec2 place;
out vec4 colour;
void main() { colour = texture(picture, place); }
"""


def plain_draw(width: int, height: int) -> Callable[[], None]:
    """A whole picture uploaded, drawn and read back."""
    context = start_opengl()
    picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    data = picture.tobytes()
    with context:
        program = context.program(vertex_shader=QUAD, fragment_shader=FILL)
        corners = np.array([0, 0, 1, 0, 0, 1, 1, 1], np.float32)
        quad = context.vertex_array(program, [(context.buffer(corners.tobytes()), "2f", "corner")])
        texture = context.texture((width, height), 3, alignment=1)
        target = context.framebuffer([context.renderbuffer((width, height), 4)])

    def draw() -> None:
        with context:
            target.use()
            texture.write(data, alignment=1)
            texture.use(0)
            quad.render(moderngl.TRIANGLE_STRIP)
            target.read(components=4)

    return draw


def rendering(synthesizer: unitsel.Synthesizer) -> None:
    """Print the speed of rendering against plain draws."""
    database = synthesizer.database
    background = synthesizer.background()
    selection = synthesizer.select(database.sequence_track(1), exclude_sequences=[1])
    patch = database.mask.patch
    alpha = blend_alpha(database.mask)
    transfer = ColourTransfer(alpha)
    pictures = UnitPictures(database)
    print("rendering, relative to a plain full-screen draw with read back (medians):")
    for width, height in SIZES:
        whole = [Placed(selection, 0, 0.0, 0, ROUNDS)]
        with Playback(background, 25, patch, database.camera, length=ROUNDS) as played:
            frames = list(pictures.decoded(whole, played, Fraction(25), (width, height)))
        plain = plain_draw(width, height)
        painter = pictures.painter((width, height))
        camera = database.camera.scaled_to(width, height)
        shown = frames[0].frame
        seen = cut_from_planes(frames[0].planes, shown.colour, patch, shown.pose, camera)
        times: list[list[float]] = []
        with Scene(width, height, patch, camera, alpha) as scene:
            for frame in frames:
                marks = [time.perf_counter()]
                plain()
                marks.append(time.perf_counter())
                scene.draw(frame.crop, frame.frame.pose)
                marks.append(time.perf_counter())
                composite(frame.planes, painter.paint(frame), frame.frame.colour)
                marks.append(time.perf_counter())
                transfer.field(seen, frame.crop)
                marks.append(time.perf_counter())
                times.append(np.diff(marks).tolist())
        full, mouth, drawn, fit = np.median(np.array(times[5:]), axis=0)
        print(f"  {width} x {height}: plain draw {1e3 * full:.2f} ms")
        for name, taken in (
            ("mouth drawn and read back", mouth),
            ("whole frame: colour, draw, read back, laid over", drawn),
            ("whole frame, and its colour fitted", drawn + fit),
        ):
            print(f"    {name:<48} {1e3 * taken:.2f} ms, ratio {full / taken:.2f}")


def minute(database: Path, synthesizer: unitsel.Synthesizer) -> None:
    """Print how a timing file of a minute becomes a video."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        speech = speak(TEXT * 3, wav=folder / "speech.wav")
        timing = folder / "speech.TextGrid"
        write_timing(timing, Timing(speech.track, speech.words))
        length = speech.track.end
        command = [sys.executable, "-m", "unitsel", "synth", str(database), str(timing)]
        command += ["--audio", str(folder / "speech.wav"), "-o"]
        before = os.times()
        started = time.perf_counter()
        subprocess.run([*command, str(folder / "a.mp4")], check=True, stdout=subprocess.DEVNULL)
        taken = time.perf_counter() - started
        after = os.times()
        used = (after.children_user - before.children_user) + (
            after.children_system - before.children_system
        )
        print(f"timing file to mp4, {length:.0f} s of video, its sound encoded:")
        print(
            f"  as a process that is started   {taken:.2f} s   {length / taken:.1f} times real "
            f"time   (cpu {used:.2f} s)"
        )
        started, cpu = time.perf_counter(), time.process_time()
        track = unitsel.read_timing(timing).phones
        selection = synthesizer.select(track)
        selected = time.perf_counter() - started
        written = synthesizer.write(selection, folder / "b.mp4", audio=folder / "speech.wav")
        taken, cpu = time.perf_counter() - started, time.process_time() - cpu
        print(
            f"  in a process that runs         {taken:.2f} s   {length / taken:.1f} times real "
            f"time   (cpu {cpu:.2f} s; selecting {selected:.2f} s; {written.frames} frames)"
        )


def first_picture(synthesizer: unitsel.Synthesizer) -> None:
    """Print how long the first picture takes."""
    background = synthesizer.background()
    taken, used = [], []
    for i in range(-1, 2 * len(SENTENCES)):
        started, cpu = time.perf_counter(), time.process_time()
        speech = speak(SENTENCES[i % len(SENTENCES)])
        frames = synthesizer.stream([speech.track], background=background)
        next(frames)
        if i >= 0:
            taken.append(1e3 * (time.perf_counter() - started))
            used.append(1e3 * (time.process_time() - cpu))
        frames.close()
    print(
        f"first picture of a text, {len(taken)} texts: median {np.median(taken):.0f} ms, "
        f"longest {max(taken):.0f} ms (cpu {np.median(used):.0f} ms)"
    )


def uneven(source: Path, target: Path, fps: float) -> Path:
    """A copy of a video that leaves out frames and so has a variable rate."""
    frames = [f for f in read_video(source, fps) if f.index % 5 not in (1, 3)]
    with av.open(str(target), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height = frames[0].planes.width, frames[0].planes.height
        stream.codec_context.time_base = Fraction(1, 1000)
        for f in frames:
            frame = av.VideoFrame.from_ndarray(f.planes.packed(), format="yuv420p")
            frame.pts, frame.time_base = round(1000 * f.index / fps), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return target


def drift(synthesizer: unitsel.Synthesizer) -> None:
    """Print the greatest distance of sound and picture at five frame rates."""
    own = synthesizer.background()
    tracks = [synthesizer.database.sequence_track(s) for s in range(20)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = uneven(own.path, folder / "uneven.mkv", own.fps)
        background = type(own)(path, own.fps, own.first, own.poses)
        print("drift of sound and picture over a minute, background of variable rate:")
        for rate in RATES:
            out = folder / "out.mp4"
            begun: list[Placed[Selection]] = []

            def spoken() -> Iterator[tuple[unitsel.PhonemeTrack, Sound]]:
                for track in tracks:
                    samples = np.zeros(round(track.end * 16000), np.float32)
                    samples[:64] = 0.9
                    yield track, Sound(samples, 16000)

            written = synthesizer.write_stream(
                spoken(), out, background=background, fps=rate, begun=begun.append
            )
            with av.open(str(out)) as container:
                video = container.streams.video[0]
                stamps = [float(f.pts * f.time_base) for f in container.decode(video)]
            heard = np.abs(read_sound(out, None).samples) > 0.3
            worst = 0.0
            for utterance in begun:
                low = max(0, round((utterance.start - 0.5) * 16000))
                click = (low + int(np.argmax(heard[low:]))) / 16000
                worst = max(worst, abs(stamps[utterance.first] - click))
            frame_time = 1 / written.fps
            print(
                f"  {rate:g} a second: {1e3 * worst:.1f} ms of {1e3 * frame_time:.1f} ms a frame, "
                f"{worst / frame_time:.2f} frames"
            )


def main() -> int:
    """Print everything; without a database or espeak say what is missing."""
    named = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("UNITSEL_BENCH_DB")
    path = Path(named or "out/demo.h5")
    if not path.is_file():
        print(f"realtime: no database at {path}; make demo writes one, or name one")
        return 0
    try:
        speak("warm")
    except SpeechError as error:
        print(f"realtime: {error}")
        return 0
    with unitsel.open_database(path) as database:
        synthesizer = unitsel.Synthesizer(database)
        load = os.getloadavg()[0]
        print(f"{path}: {len(database)} units; {os.cpu_count()} cores, load {load:.1f}")
        rendering(synthesizer)
        first_picture(synthesizer)
        minute(path, synthesizer)
        drift(synthesizer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
