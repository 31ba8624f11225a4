"""What a bake writes: glTF, preview, report, and how they get into their folder whole or not at all."""
