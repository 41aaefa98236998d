"""The second mode: a virtual mass that is drawn to a target seen in stereo and kept clear of everything."""
