//! Pictures that stay on the device: from radiance to a texture that a window draws.

use wgpu::util::DeviceExt;

use super::GpuRelighter;
use super::device::compile;
use super::kernels::{TONE, ToneBinding};
use super::resident::{per_block, relight};
use crate::error::{Error, Result};
use crate::image::{LinearImage, ToneMapping};
use crate::light::Lighting;
use crate::matrix::MatrixShape;
use crate::relight::cpu::check_columns;
use crate::relight::tiles::for_each_tile;

/// How radiance is displayed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShownAs {
    /// Tone-mapped.
    Toned(ToneMapping),
    /// Luminance as [`false_colour`](crate::image::false_colour) shows it.
    FalseColour {
        /// Luminance that is shown as black; above 0.
        low: f32,
        /// Luminance that is shown as white; above `low`, and finite.
        high: f32,
    },
}

/// The uniform of `shaders/tone.wgsl`.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Tone {
    pub(super) gain: [f32; 3],
    pub(super) curve: u32,
    pub(super) width: u32,
    pub(super) side: u32,
    pub(super) low_stops: f32,
    pub(super) range_stops: f32,
}

impl Tone {
    fn new(shape: MatrixShape, shown_as: ShownAs) -> Self {
        let (gain, curve, [low, high]) = match shown_as {
            ShownAs::Toned(tone) => (tone.gains(), tone.curve as u32, [1.0, 2.0]),
            ShownAs::FalseColour { low, high } => ([1.0; 3], 4, [low, high]),
        };
        let (low_stops, range_stops) = (low.log2(), high.log2() - low.log2());
        Self { gain, curve, width: shape.width(), side: shape.block_side(), low_stops, range_stops }
    }
}

/// A relighter with a texture in which it shows its pictures: nothing is read back for them.
pub struct GpuScreen {
    relighter: GpuRelighter,
    texture: wgpu::Texture,
    tone: wgpu::Buffer,
    pipeline: wgpu::ComputePipeline,
    /// For each bank the bindings and the number of workgroups.
    passes: Vec<(wgpu::BindGroup, [u32; 3])>,
}

impl GpuScreen {
    /// Gives a relighter a screen of the picture's size, black but for the stripes of holes.
    ///
    /// # Errors
    /// A picture that is larger than a texture may be; [`Error::NoGpu`] where the device fails.
    pub fn new(relighter: GpuRelighter) -> Result<Self> {
        let (gpu, shape) = (&relighter.gpu, relighter.shape);
        let (width, height) = (shape.width(), shape.height());
        let most = gpu.device.limits().max_texture_dimension_2d;
        if width.max(height) > most {
            return Err(Error::Resources {
                what: "a texture for the picture".into(),
                needed: format!("{width} × {height} pixels"),
                available: format!("the limit is {most} on a side"),
                hint: "relight on the CPU".into(),
            });
        }
        let usage = wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::COPY_DST;
        let descriptor = wgpu::TextureDescriptor {
            label: Some("screen"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage,
            view_formats: &[],
        };
        let blank = blank(&relighter);
        let order = wgpu::util::TextureDataOrder::default();
        let texture = gpu.device.create_texture_with_data(&gpu.queue, &descriptor, order, &blank);
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let tone = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("tone_mapping"),
            size: size_of::<Tone>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let pipeline = compile(&gpu.device, &TONE);
        let passes = relighter.banks.iter().map(|bank| {
            let resource = |binding: ToneBinding| match binding {
                ToneBinding::ToneMapping => tone.as_entire_binding(),
                ToneBinding::Blocks => bank.blocks.as_entire_binding(),
                ToneBinding::Image => bank.image.as_entire_binding(),
                ToneBinding::Screen => wgpu::BindingResource::TextureView(&view),
            };
            let entries: Vec<_> = (0..)
                .zip(TONE.bindings)
                .map(|(binding, &what)| wgpu::BindGroupEntry { binding, resource: resource(what) })
                .collect();
            let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(TONE.name),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            (bindings, per_block(gpu, bank.places.len() as u32, bank.max_pixels))
        });
        let passes = passes.collect();
        gpu.check()?;
        Ok(Self { texture, tone, pipeline, passes, relighter })
    }

    /// Shows the picture under `lighting`, or, without one, that of the newest call in another way. It stands in the
    /// texture when this returns.
    ///
    /// # Errors
    /// As [`GpuRelighter::relight`].
    pub fn show(&self, lighting: Option<&Lighting>, shown_as: ShownAs) -> Result<()> {
        let GpuRelighter { gpu, shape, shared, banks, .. } = &self.relighter;
        if let Some(lighting) = lighting {
            check_columns(*shape, lighting)?;
        }
        let _turn = self.relighter.turn();
        if let Some(lighting) = lighting {
            shared.set(gpu, lighting);
        }
        gpu.queue.write_buffer(&self.tone, 0, bytemuck::bytes_of(&Tone::new(*shape, shown_as)));
        self.relighter.run(|pass| {
            if lighting.is_some() {
                relight(gpu, pass, banks.iter());
            }
            pass.set_pipeline(&self.pipeline);
            for (bindings, [x, y, z]) in &self.passes {
                pass.set_bind_group(0, bindings, &[]);
                pass.dispatch_workgroups(*x, *y, *z);
            }
        })
    }

    /// What shows the pictures: 8 bits a channel, sRGB-encoded, opaque.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// The relighter that computes the images.
    pub fn relighter(&self) -> &GpuRelighter {
        &self.relighter
    }

    /// Bytes of GPU memory that matrix and pictures take.
    pub fn resident_bytes(&self) -> u64 {
        let size = self.texture.size();
        self.relighter.resident_bytes() + 4 * u64::from(size.width) * u64::from(size.height)
    }
}

/// The bytes of a screen before the first picture.
fn blank(relighter: &GpuRelighter) -> Vec<u8> {
    let shape = relighter.shape;
    let mut image = LinearImage::black(shape.width(), shape.height());
    let marked = for_each_tile(&mut image, shape, |mut tile| {
        if relighter.places[tile.id.index()].is_none() {
            tile.mark_as_hole();
        }
        Ok::<_, Error>(())
    });
    marked.expect("marking does not fail");
    ToneMapping::default().bytes(&image).into_iter().flat_map(|[r, g, b]| [r, g, b, 255]).collect()
}
