"""Policies for other programs: ONNX, and plain parameters."""
