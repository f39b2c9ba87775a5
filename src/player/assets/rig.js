// rig
