//! Whatever ends the right to move, it does so at every interleaving: after every single poll of a command of motion the
//! stop is given, the lease ends, runs out or changes hands, the history fails, or the controller goes; and afterwards no
//! order goes out. Jobs are ended so at the points of their whole run.

mod commands;
mod controller;
mod jobs;
mod threads;
