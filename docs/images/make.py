"""Make the pictures of the docs anew: ``python docs/images/make.py`` (minutes; needs the extra ``plots``)."""

import subprocess
import sys
import tempfile
from pathlib import Path

import av
from hero import write_webp

HERE = Path(__file__).parent


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "jssa_gym", "demo", "--pretty", "--out", folder], check=True)
        Path(folder, "profile.png").replace(HERE / "profile.png")
        with av.open(str(Path(folder, "side_by_side.mp4"))) as film:
            frames = [frame.to_image() for frame in film.decode(video=0)]
    sweep = "certify --sweep --trigger 1.5 --states 1500 --jobs 2 --out"
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "jssa_gym", *sweep.split(), folder], check=True)
        Path(folder, "map.png").replace(HERE / "lambda_map.png")
    write_webp(HERE / "demo.webp", frames[::2], 1200)


if __name__ == "__main__":
    main()
