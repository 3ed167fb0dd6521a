//! The options for a mesh, a molecule or points alone, which have neither a camera nor lights.

use clap::Args;
use rayo::glam::{DVec3, Vec3};
use rayo::{Camera, ModelOptions, UpAxis};

/// How a mesh, a molecule or points alone are seen: as `rayo render` takes it.
#[derive(Clone, Debug, Default, Args)]
pub struct ModelArguments {
    /// The side from which a mesh, a molecule or points alone are seen as a whole: a direction in
    /// the file's own axes
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    from: Option<DVec3>,
    /// The axis of a mesh, a molecule or points alone that stands upright: x, y, z, -x, -y or -z
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    up: Option<UpAxis>,
    /// The side from which they are lit; given several times, the lights share the light
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    light: Vec<DVec3>,
    /// How much of the light, which is 1 in all, comes from the camera. Default: 0.2
    #[arg(long, value_name = "SHARE", value_parser = share)]
    ambient: Option<f32>,
    /// A factor on their colours: linear red, green and blue
    #[arg(long, value_name = "R,G,B", value_parser = colour)]
    colour: Option<Vec3>,
    /// The radius of all points or atoms
    #[arg(long, value_name = "RADIUS", value_parser = radius)]
    radius: Option<f32>,
    /// The frame, or the model, of several in a file, counted from 1
    #[arg(long, value_name = "N", value_parser = frame)]
    frame: Option<usize>,
}

impl ModelArguments {
    /// What is asked of the library, with this camera.
    pub fn options(&self, camera: Camera) -> ModelOptions {
        ModelOptions {
            up: self.up,
            from: self.from,
            lights: self.light.clone(),
            ambient: self.ambient,
            colour: self.colour.unwrap_or(Vec3::ONE),
            radius: self.radius,
            frame: self.frame,
            ..ModelOptions::of(camera)
        }
    }

    /// Whether any of them is given.
    pub fn is_given(&self) -> bool {
        self.from.is_some() || !self.text().is_empty()
    }

    /// The same as arguments of `rayo`, each after a space. The camera is where it has been turned
    /// to, and needs no side.
    pub fn text(&self) -> String {
        let mut text = String::new();
        if let Some(up) = self.up {
            text += &format!(" --up {up}");
        }
        for light in &self.light {
            text += &format!(" --light {},{},{}", light.x, light.y, light.z);
        }
        if let Some(ambient) = self.ambient {
            text += &format!(" --ambient {ambient}");
        }
        if let Some(colour) = self.colour {
            text += &format!(" --colour {},{},{}", colour.x, colour.y, colour.z);
        }
        if let Some(radius) = self.radius {
            text += &format!(" --radius {radius}");
        }
        if let Some(frame) = self.frame {
            text += &format!(" --frame {frame}");
        }
        text
    }
}

/// Three numbers with commas between them.
fn numbers(text: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers?.try_into().ok().filter(|numbers: &[f64; 3]| numbers.iter().all(|number| number.is_finite()))
}

fn direction(text: &str) -> Result<DVec3, &'static str> {
    let direction = numbers(text).map(DVec3::from_array).filter(|direction| direction.try_normalize().is_some());
    direction.ok_or("expected a direction: three numbers that are not all 0, as in 1,1,0.5")
}

fn share(text: &str) -> Result<f32, &'static str> {
    let share = text.trim().parse().ok().filter(|share| (0.0..=1.0).contains(share));
    share.ok_or("expected a number from 0 to 1")
}

fn colour(text: &str) -> Result<Vec3, &'static str> {
    let colour = numbers(text).map(|channels| Vec3::from_array(channels.map(|channel| channel as f32)));
    let colour = colour.filter(|colour| colour.is_finite() && colour.min_element() >= 0.0);
    colour.ok_or("expected three numbers of at least 0, as in 0.2,0.3,0.5")
}

fn radius(text: &str) -> Result<f32, &'static str> {
    let radius = text.trim().parse().ok().filter(|radius: &f32| *radius > 0.0 && radius.is_finite());
    radius.ok_or("expected a number greater than 0")
}

fn frame(text: &str) -> Result<usize, &'static str> {
    text.parse().ok().filter(|frame| *frame > 0).ok_or("expected a whole number from 1")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Arguments {
        #[command(flatten)]
        model: ModelArguments,
    }

    fn parsed(arguments: &str) -> Result<ModelArguments, clap::Error> {
        let arguments = arguments.split_whitespace();
        Arguments::try_parse_from(["x"].into_iter().chain(arguments)).map(|arguments| arguments.model)
    }

    #[test]
    fn arguments_are_handed_on_as_they_came() {
        let all = "--up -z --light 1,0,0 --light 0,-1,0.5 --ambient 0.25 --colour 1,0.5,0 --radius 0.125 --frame 3";
        let model = parsed(&format!("{all} --from -1,0,2")).unwrap();
        assert_eq!(model.text(), format!(" {all}"));
        let options = model.options(Camera::default());
        assert_eq!((options.from, options.lights.len()), (Some(DVec3::new(-1.0, 0.0, 2.0)), 2));
        assert_eq!(parsed("").unwrap().options(Camera::default()), ModelOptions::of(Camera::default()));
    }

    #[test]
    fn what_is_no_such_number_is_refused() {
        for arguments in [
            "--from 0,0,0",
            "--from 1,2",
            "--up w",
            "--light nan,0,0",
            "--ambient 2",
            "--colour -1,0,0",
            "--radius 0",
            "--frame 0",
        ] {
            assert!(parsed(arguments).is_err(), "{arguments}");
        }
    }
}
