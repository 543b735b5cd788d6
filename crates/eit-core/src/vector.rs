//! Vectors in three-dimensional space.

/// A point or vector, `[x, y, z]`.
pub type Vector = [f64; 3];

/// `a - b`.
#[inline]
pub fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a + t b`.
#[inline]
pub fn along(a: Vector, t: f64, b: Vector) -> Vector {
    [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]]
}

/// `t a`.
#[inline]
pub fn scaled(t: f64, a: Vector) -> Vector {
    a.map(|x| t * x)
}

/// Scalar product.
#[inline]
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
#[inline]
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Euclidean length.
#[inline]
pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// Straight distance between two points.
#[inline]
pub fn distance(a: Vector, b: Vector) -> f64 {
    norm(sub(a, b))
}

/// Index of the first of the points that are nearest to one, and its distance; `None` if there are none.
pub fn nearest(points: impl IntoIterator<Item = Vector>, to: Vector) -> Option<(usize, f64)> {
    let distances = points.into_iter().map(|point| distance(point, to)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Vector of length 1 in the direction of `a`; NaN if `a` is zero.
#[inline]
pub fn unit(a: Vector) -> Vector {
    let length = norm(a);
    a.map(|x| x / length)
}

/// Normal of a triangle, with a length of twice its area.
#[inline]
pub fn normal([a, b, c]: [Vector; 3]) -> Vector {
    cross(sub(b, a), sub(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_a_right_triangle() {
        let corners = [[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 5.0, 1.0]];
        assert_eq!(normal(corners), [0.0, 0.0, 12.0]);
        assert_eq!(unit(normal(corners)), [0.0, 0.0, 1.0]);
        assert_eq!(distance(corners[1], corners[2]), 5.0);
        assert_eq!(along(corners[0], 0.5, scaled(2.0, [0.0, 3.0, 0.0])), [1.0, 4.0, 1.0]);
    }
}
