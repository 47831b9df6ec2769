//! What stands in a texture.

/// The bytes of a texture of 8 bits a channel, row by row.
pub(crate) fn texels(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Vec<[u8; 4]> {
    let size = texture.size();
    // Rows are copied at multiples of 256 bytes.
    let row_bytes = (4 * size.width).next_multiple_of(256);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let bytes = u64::from(row_bytes * size.height);
    let descriptor = wgpu::BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false };
    let buffer = device.create_buffer(&descriptor);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
    let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_buffer(texture.as_image_copy(), target, size);
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let mapped = buffer.get_mapped_range(..).unwrap();
    let rows = mapped.chunks_exact(row_bytes as usize);
    rows.flat_map(|row| row[..4 * size.width as usize].as_chunks().0.to_vec()).collect()
}
