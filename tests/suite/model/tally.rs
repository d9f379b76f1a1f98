//! What was exercised: a model that nothing happens in proves nothing.

use std::fmt;
use std::ops::AddAssign;

/// How often each of it happened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) sequences: u64,
    /// Of each protocol.
    pub(super) of_protocol: [u64; 5],
    pub(super) steps: u64,
    pub(super) requests: u64,
    pub(super) refusals: u64,
    pub(super) at_once: u64,
    pub(super) commands: u64,
    pub(super) orders: u64,
    pub(super) jobs: u64,
    pub(super) confirmations: u64,
    pub(super) by_confirm_key: u64,
    pub(super) dead_confirm_keys: u64,
    pub(super) new_confirm_keys: u64,
    pub(super) presses_over: u64,
    pub(super) stops: u64,
    pub(super) stops_in_motion: u64,
    pub(super) resets: u64,
    pub(super) expiries_in_motion: u64,
    pub(super) releases_in_motion: u64,
    pub(super) takeovers_in_motion: u64,
    pub(super) connections: u64,
    pub(super) troubles: u64,
    pub(super) full_disks: u64,
    pub(super) kills: u64,
    pub(super) kills_in_motion: u64,
    pub(super) restarts: u64,
    pub(super) latched_restarts: u64,
    pub(super) checks: u64,
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        let Self {
            sequences,
            of_protocol,
            steps,
            requests,
            refusals,
            at_once,
            commands,
            orders,
            jobs,
            confirmations,
            by_confirm_key,
            dead_confirm_keys,
            new_confirm_keys,
            presses_over,
            stops,
            stops_in_motion,
            resets,
            expiries_in_motion,
            releases_in_motion,
            takeovers_in_motion,
            connections,
            troubles,
            full_disks,
            kills,
            kills_in_motion,
            restarts,
            latched_restarts,
            checks,
        } = other;
        self.sequences += sequences;
        for (sum, of) in self.of_protocol.iter_mut().zip(of_protocol) {
            *sum += of;
        }
        self.steps += steps;
        self.requests += requests;
        self.refusals += refusals;
        self.at_once += at_once;
        self.commands += commands;
        self.orders += orders;
        self.jobs += jobs;
        self.confirmations += confirmations;
        self.by_confirm_key += by_confirm_key;
        self.dead_confirm_keys += dead_confirm_keys;
        self.new_confirm_keys += new_confirm_keys;
        self.presses_over += presses_over;
        self.stops += stops;
        self.stops_in_motion += stops_in_motion;
        self.resets += resets;
        self.expiries_in_motion += expiries_in_motion;
        self.releases_in_motion += releases_in_motion;
        self.takeovers_in_motion += takeovers_in_motion;
        self.connections += connections;
        self.troubles += troubles;
        self.full_disks += full_disks;
        self.kills += kills;
        self.kills_in_motion += kills_in_motion;
        self.restarts += restarts;
        self.latched_restarts += latched_restarts;
        self.checks += checks;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sequences, steps, requests, refusals, at_once, commands, orders, jobs, confirmations, .. } = self;
        let Self { stops, stops_in_motion, resets, expiries_in_motion, releases_in_motion, .. } = self;
        let Self { takeovers_in_motion, connections, troubles, full_disks, kills, kills_in_motion, .. } = self;
        let Self { restarts, latched_restarts, checks, by_confirm_key, dead_confirm_keys, .. } = self;
        let Self { of_protocol, new_confirm_keys, presses_over, .. } = self;
        write!(
            f,
            "{sequences} sequences, {steps} steps, {requests} requests ({refusals} refused, {at_once} two at a time), \
             {commands} commands, {orders} orders on the wire, {jobs} jobs, {confirmations} confirmations \
             ({by_confirm_key} by confirm key, {dead_confirm_keys} tried with a dead one), {new_confirm_keys} new confirm \
             keys, {presses_over} presses that were over, \
             {stops} stops ({stops_in_motion} in motion), {resets} resets, in motion {expiries_in_motion} expiries, \
             {releases_in_motion} releases, {takeovers_in_motion} takeovers; {connections} connections, \
             {troubles} troubles, {full_disks} full disks, {kills} kills ({kills_in_motion} in motion), \
             {restarts} restarts, {latched_restarts} of all starts latched; {of_protocol:?} of each protocol; \
             {checks} checks of invariants"
        )
    }
}
