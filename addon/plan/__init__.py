"""What is decided before the work starts, by functions of plain values: nothing here imports `bpy`."""
