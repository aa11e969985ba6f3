//! What goes wrong is survived, counted and told; nothing wrong is given as a point.
