"""Ground truth beyond labels and depth that a run may request: normals, boxes, joints, flow."""
