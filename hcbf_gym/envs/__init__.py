"""The Gymnasium environments; the only place that steps MuJoCo."""
