"""Resolution of a spec against its asset: values, sensors, motion, requirements."""
