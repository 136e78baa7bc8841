"""`apf view OUT TRACK`: show voxels and the tracked body in one window."""

from __future__ import annotations

import argparse

import numpy as np

from apf.body.kinematics import posed_cones
from apf.cli.takes.opened_track import open_given_track
from apf.report.overlay import overlay_picture
from apf.report.viewer_layers import cone_layer, describe_frame, skeleton_layer
from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.cli.view import OnTop, view_run
from psfs.sequence import Frame


def run(args: argparse.Namespace) -> None:
    track = open_given_track(args)
    body = track.its_body

    def picture(frame: Frame, rig: CameraRig) -> np.ndarray:
        if frame.index not in track.frames:
            raise InputError(f"{args.track}: frame {frame.index} was not tracked")
        row = int(np.flatnonzero(track.frames == frame.index)[0])
        shown = [i for i, cone in enumerate(body.cones) if cone.in_images]
        cones = posed_cones(body, track.poses[row : row + 1])[0, shown]
        names = [body.cone_names[i] for i in shown]
        return overlay_picture(frame, rig, cones, names, track.joints[row], track.edges)

    layers = (skeleton_layer(track), cone_layer(track, body))
    view_run(args, OnTop(layers, lambda frame: describe_frame(track, frame), picture))
