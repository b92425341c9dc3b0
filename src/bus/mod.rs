//! Shared memory between the processes of a rig; the only room that opens iceoryx2.
