//! Records as files: read as a user meets them, written, and damaged.

mod damaged;
mod mat;
mod noise;
mod text;
