pub fn text(_: &crate::experiments::ops::Report) -> String {
    String::new()
}
