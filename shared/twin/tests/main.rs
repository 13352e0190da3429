//! What the twin must get right, by topic.

mod common;
/// Frames: light, noise, range, threads.
mod frames;
/// Ray, distance and mesh against brute force.
mod geometry;
/// Defocus, drift, bounce, exposures: what each setting does, by its definition.
mod imperfections;
/// Edges of a print.
mod print;
/// A projector of 8 bits.
mod rounding;
/// Scene files: what is refused and how it is said; the scenes of the project.
mod scenes;
/// Views: projector coordinates, shadow and occlusion against marching.
mod views;
