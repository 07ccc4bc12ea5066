//! The program as its users meet it: the real binary, its files, its streams and its exit codes.

mod bad_records;
mod check;
mod data;
mod effort;
mod guide;
mod harness;
mod identify;
mod interrupt;
mod json;
mod measured;
mod output;
mod report;
mod reproduce;
mod schema;
mod shell;
mod simulate;
mod streams;
mod terminal;
mod usage;
