//! A skin, its touches and images in Foxglove's schemas.

use crate::SkinShape;
use crate::outbox::{FrameCopy, ImageCopy};
use eit_skin::TouchFields;
use foxglove::messages::{
    ArrowPrimitive, Color, Duration, Grid, LinePrimitive, PackedElementField, Point3, Pose,
    Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive, Timestamp, Vector2,
    Vector3, line_primitive, packed_element_field,
};

/// Touches vanish when nothing has been sent for so long.
const LIFETIME_S: f64 = 0.5;
/// Slower touches have no arrow, metres per second; an arrow is as long as the path in a tenth of a
/// second.
const SLOW_M_S: f64 = 0.02;
const ARROW_S: f64 = 0.1;

const OUTLINE: Color = Color { r: 0.55, g: 0.58, b: 0.62, a: 1.0 };
const ELECTRODE: Color = Color { r: 0.95, g: 0.65, b: 0.15, a: 1.0 };
const VALID: Color = Color { r: 0.90, g: 0.15, b: 0.20, a: 0.9 };
const INVALID: Color = Color { r: 0.90, g: 0.15, b: 0.20, a: 0.35 };
const FAULTY: Color = Color { r: 0.75, g: 0.10, b: 0.75, a: 1.0 };

/// Draws; knows the size of the skin once it has drawn its outline.
#[derive(Debug)]
pub(super) struct Painter {
    frame_id: String,
    /// Largest side of the skin, metres.
    size_m: f64,
    /// Middle of each electrode, metres.
    electrodes_m: Vec<[f64; 2]>,
}

impl Painter {
    pub(super) fn new(frame_id: &str) -> Self {
        let frame_id = frame_id.to_owned();
        Self { frame_id, size_m: 0.2, electrodes_m: Vec::new() }
    }

    fn entity(&self, id: &str, time: Timestamp, lifetime_s: f64) -> SceneEntity {
        SceneEntity {
            timestamp: Some(time),
            frame_id: self.frame_id.clone(),
            id: id.to_owned(),
            lifetime: Some(Duration::saturating_from_secs_f64(lifetime_s)),
            frame_locked: true,
            ..Default::default()
        }
    }

    /// Outline and electrodes, which stay until they are replaced.
    pub(super) fn outline(&mut self, shape: &SkinShape, time: Timestamp) -> SceneUpdate {
        let [x0, x1, y0, y1] = shape.extent_m;
        self.size_m = (x1 - x0).max(y1 - y0);
        let middle = |points: &Vec<[f64; 2]>| {
            let count = points.len().max(1) as f64;
            [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count)
        };
        self.electrodes_m = shape.electrodes_m.iter().map(middle).collect();
        let line =
            |points: &[[f64; 2]], kind: line_primitive::Type, color, thickness| LinePrimitive {
                r#type: kind.into(),
                pose: Some(pose([0.0; 3])),
                thickness,
                scale_invariant: true,
                points: points.iter().map(|&[x, y]| Point3 { x, y, z: 0.0 }).collect(),
                color: Some(color),
                ..Default::default()
            };
        let outlines = shape.outlines_m.iter();
        let outlines =
            outlines.map(|points| line(points, line_primitive::Type::LineLoop, OUTLINE, 2.0));
        let electrodes = shape.electrodes_m.iter();
        let electrodes =
            electrodes.map(|points| line(points, line_primitive::Type::LineStrip, ELECTRODE, 5.0));
        let mut entity = self.entity("skin", time, 0.0);
        entity.lines = outlines.chain(electrodes).collect();
        SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
    }

    /// Draws touches as spheres with velocity and force, and faulty electrodes, replacing the
    /// previous ones.
    pub(super) fn touches(&self, frame: &FrameCopy, time: Timestamp) -> SceneUpdate {
        let why = frame.state.why_not_known().map(|why| format!("Not known: {why}"));
        let touches = frame.touches.iter().map(TouchFields::from);
        let mut entity = self.touched(touches, why, time);
        let faulty = frame.faults.iter();
        for [x, y] in faulty.filter_map(|fault| self.electrodes_m.get(fault.electrode)) {
            entity.spheres.push(sphere([*x, *y, 0.0], 0.04 * self.size_m, FAULTY));
        }
        SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
    }

    /// Draws the touches that have not ended, and says what is not known.
    pub(super) fn touched(
        &self,
        touches: impl Iterator<Item = TouchFields>,
        not_known: Option<String>,
        time: Timestamp,
    ) -> SceneEntity {
        let mut entity = self.entity("touches", time, LIFETIME_S);
        for touch in touches.filter(|touch| touch.state != "end") {
            entity.spheres.push(self.sphere(&touch));
            entity.arrows.extend(self.arrow(&touch));
            entity.texts.push(self.label(&touch));
        }
        entity.texts.extend(not_known.map(|why| text([0.0; 3], why)));
        entity
    }

    fn sphere(&self, touch: &TouchFields) -> SpherePrimitive {
        let color = if touch.valid { VALID } else { INVALID };
        sphere(touch.position_m, 0.06 * self.size_m, color)
    }

    fn arrow(&self, touch: &TouchFields) -> Option<ArrowPrimitive> {
        let [x, y, z] = touch.velocity_m_s;
        let speed = (x * x + y * y + z * z).sqrt();
        (speed.is_finite() && speed > SLOW_M_S).then(|| ArrowPrimitive {
            pose: Some(Pose {
                position: Some(vector(touch.position_m)),
                orientation: Some(from_x_axis([x / speed, y / speed, z / speed])),
            }),
            shaft_length: ARROW_S * speed,
            shaft_diameter: 0.01 * self.size_m,
            head_length: 0.03 * self.size_m,
            head_diameter: 0.025 * self.size_m,
            color: Some(VALID),
        })
    }

    fn label(&self, touch: &TouchFields) -> TextPrimitive {
        let [x, y, z] = touch.position_m;
        let label = match touch.force_n {
            Some(force_n) => format!("{} {force_n:.1} N", touch.id),
            None => touch.id.to_string(),
        };
        text([x, y, z + 0.06 * self.size_m], label)
    }

    /// An image as a grid, whose first cell is at the least x and y: conductivity change in siemens, and colours,
    /// transparent outside the skin.
    pub(super) fn grid(&self, image: &ImageCopy, extent_m: [f64; 4], time: Timestamp) -> Grid {
        const CELL: u32 = 8;
        let [x0, x1, y0, y1] = extent_m;
        let mut data = Vec::with_capacity(image.values.len() * CELL as usize);
        for row in image.values.chunks_exact(image.columns.max(1)).rev() {
            for value in row {
                data.extend_from_slice(&value.to_le_bytes());
                data.extend_from_slice(&color(value / image.range));
            }
        }
        let field = |name: &str, offset, kind: packed_element_field::NumericType| {
            PackedElementField { name: name.to_owned(), offset, r#type: kind.into() }
        };
        let [rows, columns] = [image.rows, image.columns].map(|count| count as u32);
        use packed_element_field::NumericType::{Float32, Uint8};
        Grid {
            timestamp: Some(time),
            frame_id: self.frame_id.clone(),
            pose: Some(pose([x0, y0, 0.0])),
            column_count: columns,
            cell_size: Some(Vector2 {
                x: (x1 - x0) / f64::from(columns.max(1)),
                y: (y1 - y0) / f64::from(rows.max(1)),
            }),
            row_stride: columns * CELL,
            cell_stride: CELL,
            fields: vec![
                field("conductivity", 0, Float32),
                field("red", 4, Uint8),
                field("green", 5, Uint8),
                field("blue", 6, Uint8),
                field("alpha", 7, Uint8),
            ],
            data: data.into(),
        }
    }
}

/// Blue to white to red over -1 to 1; transparent for NaN.
fn color(value: f32) -> [u8; 4] {
    if !value.is_finite() {
        return [0; 4];
    }
    let value = value.clamp(-1.0, 1.0);
    let fade = |amount: f32| (255.0 * (1.0 - amount)).round() as u8;
    let weak = fade(value.abs());
    if value < 0.0 { [weak, weak, 255, 255] } else { [255, weak, weak, 255] }
}

fn text(position_m: [f64; 3], text: String) -> TextPrimitive {
    TextPrimitive {
        pose: Some(pose(position_m)),
        billboard: true,
        font_size: 14.0,
        scale_invariant: true,
        color: Some(VALID),
        text,
    }
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

pub(super) fn pose(position: [f64; 3]) -> Pose {
    let orientation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
    Pose { position: Some(vector(position)), orientation: Some(orientation) }
}

fn sphere(position: [f64; 3], diameter: f64, color: Color) -> SpherePrimitive {
    SpherePrimitive {
        pose: Some(pose(position)),
        size: Some(vector([diameter; 3])),
        color: Some(color),
    }
}

/// The rotation of the x axis, along which arrows point, to a direction of length 1.
fn from_x_axis([x, y, z]: [f64; 3]) -> Quaternion {
    // half-way rotation (1 + a.b, a x b); opposite directions turn about z
    let w = 1.0 + x;
    if w < 1e-9 {
        return Quaternion { x: 0.0, y: 0.0, z: 1.0, w: 0.0 };
    }
    let length = (w * w + y * y + z * z).sqrt();
    Quaternion { x: 0.0, y: -z / length, z: y / length, w: w / length }
}
