"""Cameras placed by an arrangement."""
from __future__ import annotations
from dataclasses import replace
import numpy as np
from psfs.cameras.camera import CameraRig

def place_cameras(cameras, views, angles, lags, stature):
    """views: (V,) UprightViews chosen; angles rad; lags in their frames"""
    placed=[]
    ref=views[0].places
    for camera, view, angle, lag in zip(cameras, views, angles, lags, strict=True):
        c,s=np.cos(angle),np.sin(angle)
        turn=np.array([[c,-s],[s,c]])
        lag=int(round(lag))
        first,end=max(0,-lag),min(len(ref),len(view.places)-lag)
        a,b=ref[first:end],view.places[first+lag:end+lag]
        known=np.isfinite(a).all(1)&np.isfinite(b).all(1)
        if known.sum()>=4: shift=a[known].mean(0)-turn@b[known].mean(0)
        else: shift=np.nanmean(ref,0)-turn@np.nanmean(view.places,0)
        R=view.axes.T.copy()  # floor (own) -> camera
        world=np.eye(3); world[:2,:2]=turn
        Rw=R@world.T
        centre=stature*np.array([*shift,view.height])
        placed.append(replace(camera,R=Rw,t=-Rw@centre))
    return CameraRig(tuple(placed))
