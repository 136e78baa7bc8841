"""The automatic start: body and first pose of a person from the first voxel clouds."""
