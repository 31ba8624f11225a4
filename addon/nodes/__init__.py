"""Node groups: pruning, transitions, wind and LOD ranges that follow the camera, without the extension."""
