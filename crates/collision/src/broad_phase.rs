//! Refitted bounding volumes of a deforming surface.
