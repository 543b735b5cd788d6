//! Meshes, rasters and errors can be shared between threads.

#[test]
fn types_are_send_and_sync() {
    fn shared<T: Send + Sync + Clone + std::fmt::Debug>() {}
    shared::<eit_mesh::Mesh>();
    shared::<eit_mesh::Surface>();
    shared::<eit_mesh::Raster>();
    shared::<eit_mesh::CsrMatrix>();
    shared::<eit_mesh::Outline>();
    shared::<eit_mesh::MeshSettings>();
    shared::<eit_mesh::Repairs>();
    shared::<eit_mesh::MeshError>();
}
