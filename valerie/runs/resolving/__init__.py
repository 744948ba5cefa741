"""From a spec and its asset to what the run is: values, sensors, motion, requirements."""
