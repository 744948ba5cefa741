"""Truth that a run asks for beyond labels and depth: normals, boxes, joints."""
