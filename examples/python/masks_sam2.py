"""Writes the robot's masks by SAM 2: prompted in one picture of each camera, propagated through all others.

    pip install sam2 pillow
    tdcr log pictures DATA/log.mcap --out FRAMES
    python masks_sam2.py --frames FRAMES --prompts prompts.json --out MASKS
    tdcr capture ... --masks MASKS

FRAMES has a folder per camera with its colour pictures in the order of the samples: camera0/000000.png, camera0/000001.png, ...
(or .jpg).
The prompts say where the robot is in one sample of each camera, by points (columns and rows of pixels; labels 1 on the robot, 0
beside it):

    {"camera0": {"sample": 0, "points": [[640, 300], [600, 420], [900, 500]], "labels": [1, 1, 0]}, "camera1": ...}

MASKS gets camera0/000000.png and so on: 8 bits, grey, 255 on the robot. Look through them before they are used.
"""

import argparse
import json
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np


class MaskError(Exception):
    """What is wrong with the input, and what would be right."""


def load(name: str):
    """SAM 2's video predictor."""
    try:
        from sam2.sam2_video_predictor import SAM2VideoPredictor
    except ImportError as error:
        hint = "pip install sam2 (and huggingface_hub, for its weights)"
        raise MaskError(f"SAM 2 is not installed here ({error}); {hint}, best on a machine with a GPU") from error
    return SAM2VideoPredictor.from_pretrained(name)


def samples(folder: Path) -> dict[int, Path]:
    """The pictures of a camera by their samples, in their order."""
    paths = [path for path in folder.glob("*") if path.suffix in (".png", ".jpg") and path.stem.isdigit()]
    if not paths:
        raise MaskError(f"no pictures in {folder}; expected 000000.png, 000001.png, ...")
    return {int(path.stem): path for path in sorted(paths, key=lambda path: int(path.stem))}


def as_video(pictures: dict[int, Path], folder: Path) -> None:
    """Writes pictures as SAM 2 reads a video: JPEG files, numbered from 0."""
    from PIL import Image

    for frame, path in enumerate(pictures.values()):
        with Image.open(path) as picture:
            picture.convert("RGB").save(folder / f"{frame}.jpg", quality=95)


def propagate(predictor, folder: Path, prompt: dict, out: Path) -> int:
    """Writes the masks of one camera; returns how many."""
    from PIL import Image

    pictures = samples(folder)
    numbers = list(pictures)
    if prompt["sample"] not in pictures:
        raise MaskError(f"sample {prompt['sample']} of the prompts is not in {folder}; there are {numbers[0]} to {numbers[-1]}")
    with tempfile.TemporaryDirectory() as video:
        as_video(pictures, Path(video))
        state = predictor.init_state(video_path=video)
    predictor.add_new_points_or_box(
        inference_state=state,
        frame_idx=numbers.index(prompt["sample"]),
        obj_id=1,
        points=np.array(prompt["points"], dtype=np.float32),
        labels=np.array(prompt["labels"], dtype=np.int32),
    )
    # Forwards from the prompt to the last sample, then backwards to the first.
    masks = {}
    for reverse in (False, True):
        for index, _, logits in predictor.propagate_in_video(state, reverse=reverse):
            masks[index] = np.asarray((logits[0, 0] > 0).cpu())
    out.mkdir(parents=True, exist_ok=True)
    for index, mask in masks.items():
        Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(out / f"{numbers[index]:06}.png")
    return len(masks)


def main(arguments: list[str] | None = None, load=load) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=Path, required=True)
    parser.add_argument("--prompts", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--model", default="facebook/sam2.1-hiera-large", help="name at Hugging Face (%(default)s)")
    options = parser.parse_args(arguments)
    try:
        predictor = load(options.model)
        with ExitStack() as stack:
            if getattr(predictor, "device", None) is not None:
                import torch

                stack.enter_context(torch.inference_mode())
                if torch.cuda.is_available():
                    stack.enter_context(torch.autocast("cuda", dtype=torch.bfloat16))
            for camera, prompt in json.loads(options.prompts.read_text()).items():
                count = propagate(predictor, options.frames / camera, prompt, options.out / camera)
                print(f"{camera}: {count} masks")
    except MaskError as error:
        print(f"masks_sam2: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
