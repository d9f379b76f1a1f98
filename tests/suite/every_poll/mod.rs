//! Whatever ends the right to move, it does so at every interleaving: after every single poll of a command of motion the
//! stop is given, the lease ends or changes hands, the history fails, or the controller goes; and afterwards no order
//! goes out.

mod commands;
mod controller;
mod threads;
