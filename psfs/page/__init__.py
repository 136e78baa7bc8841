"""The page in the browser that `psfs view` opens, and that apf's pages extend: the check of its
token, the 3-D view of voxels and cameras, time line, pictures. Needs the extra `studio`."""
